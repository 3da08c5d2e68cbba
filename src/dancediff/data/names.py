"""Names of takes, of whatever a file or a song is called."""

import re
from hashlib import sha256


def plain_name(text: str) -> str:
    """A name that a file of the prepared folder can have; others may have the same one.

    >>> plain_name("Salsa no. 1 (live)"), plain_name(".")
    ('Salsa_no._1_live', 'take')
    """
    return re.sub(r"[^A-Za-z0-9_.+-]+", "_", text).strip("_.+-")[:120] or "take"


def short_hash(text: str) -> str:
    """Six hexadecimal digits of a text's hash; they keep apart what would have one name.

    >>> short_hash("a.bvh")
    'fa5156'
    """
    return sha256(text.encode(errors="surrogateescape")).hexdigest()[:6]


def take_name(text: str) -> str:
    """``text`` where a take can be called so, else a plain name that no other text has.

    >>> take_name("v_01_0_100"), take_name("v_01_0_100 (1)")
    ('v_01_0_100', 'v_01_0_100_1_add2cd')
    """
    if re.fullmatch(r"[A-Za-z0-9_.+-]{1,120}", text):
        return text
    return f"{plain_name(text)}_{short_hash(text)}"
