"""Requests for a dance, one class a family of models.

Read first: `dancediff.generation.dance_request`. An option's ``metadata`` says what it does and
which values it may have: the command line, panels and the generated page read it there.
"""

from dancediff.generation.autoregressive_request import AUTOREGRESSIVE
from dancediff.generation.dance_request import DanceRequest
from dancediff.generation.lodge_request import LodgeRequest
from dancediff.generation.presets import PRESETS
from dancediff.generation.segmented_request import EDGERequest, GCDRequest, TCDiffRequest
from dancediff.generation.tcdiffpp_request import TCDiffPPRequest

_ALL: tuple[type[DanceRequest], ...] = (
    *(TCDiffPPRequest, LodgeRequest, EDGERequest, GCDRequest, TCDiffRequest),
    *AUTOREGRESSIVE,
)
REQUESTS: dict[str, type[DanceRequest]] = {one.family: one for one in _ALL}


def request_of(family: str, name: str, options: dict) -> DanceRequest:
    """The request with these options, asked of the model ``name``.

    Raises: ValueError for an option that belongs to another family of models, or is none; and as
    the request itself.

    >>> request_of("tcdiffpp", "trio", {"soft": 0.5})
    Traceback (most recent call last):
    ValueError: soft=0.5 is not for the model 'trio'; models of lodge have it
    """
    kind = REQUESTS[family]
    for key, value in options.items():
        if key in kind.names():
            continue
        others = [other.family for other in REQUESTS.values() if key in other.names()]
        if others:
            raise ValueError(
                f"{key}={value!r} is not for the model {name!r}; "
                f"models of {' and '.join(others)} have it"
            )
        raise ValueError(f"{key}={value!r} is no option; choose from {', '.join(kind.names())}")
    return kind(**options)


def default_of(family: str, name: str, preset: str = DanceRequest.preset):
    """What an option is where nobody says otherwise; None: it follows from model and song.

    >>> default_of("tcdiffpp", "steps"), default_of("tcdiffpp", "steps", "paper")
    (8, 50)
    >>> default_of("lodge", "soft"), default_of("lodge", "beat_align")
    (0.75, True)
    """
    own = REQUESTS[family].__dataclass_fields__[name].default
    return PRESETS[preset][family].get(name, own)
