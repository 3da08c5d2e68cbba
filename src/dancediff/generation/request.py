"""Requests for a dance, one class a family of models.

Read first: `dancediff.generation.dance_request`. An option's ``metadata`` says what it does and
which values it may have: the command line, panels and the generated page read it there.
"""

from dancediff.generation.autoregressive_request import AUTOREGRESSIVE
from dancediff.generation.dance_request import DanceRequest
from dancediff.generation.group_request import (
    EDGERequest,
    GCDRequest,
    GroupDanceRequest,
    TCDiffRequest,
)
from dancediff.generation.presets import PRESETS
from dancediff.generation.solo_request import LodgeRequest

_ALL: tuple[type[DanceRequest], ...] = (
    *(GroupDanceRequest, LodgeRequest, EDGERequest, GCDRequest, TCDiffRequest),
    *AUTOREGRESSIVE,
)
REQUESTS: dict[str, type[DanceRequest]] = {one.family: one for one in _ALL}
RENAMED = {  # old name: (new name, what the old values are now)
    "feet": ("foot_contact", {"planted": True, "free": False}),
    "spacing": ("collision_avoidance", {"kept": True, "free": False}),
    "order": ("order_constraint", {"kept": True, "free": False}),
    "home": ("return_to_origin", {}),
    "long": ("long_sampling", {}),
}


def request_of(family: str, name: str, options: dict) -> DanceRequest:
    """The request with these options, asked of the model ``name``.

    Raises: ValueError for an option that has another name now, belongs to another family of
    models, or is none; and as the request itself.

    >>> request_of("lodge", "lodge", {"home": False})
    Traceback (most recent call last):
    ValueError: home=False is now return_to_origin=False
    >>> request_of("tcdiffpp", "trio", {"soft": 0.5})
    Traceback (most recent call last):
    ValueError: soft=0.5 is not for the model 'trio'; models of lodge have it
    """
    kind = REQUESTS[family]
    for key, value in options.items():
        if key in kind.names():
            continue
        if key in RENAMED:
            new, values = RENAMED[key]
            value_now = values.get(value, value) if isinstance(value, str) else value
            raise ValueError(f"{key}={value!r} is now {new}={value_now!r}")
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
    >>> default_of("lodge", "soft")
    1.0
    """
    own = REQUESTS[family].__dataclass_fields__[name].default
    return PRESETS[preset][family].get(name, own)
