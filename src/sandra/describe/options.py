"""What a prompt tells beyond the paper's figure; all of it is off unless asked for."""

from __future__ import annotations

from dataclasses import dataclass, field

from sandra.describe.beams import Beams
from sandra.describe.criticality import MEASURES
from sandra.describe.templates import Templates
from sandra.describe.types import VIEWS
from sandra.errors import SettingsError


@dataclass(frozen=True, slots=True)
class PromptOptions:
    """How a scene is told. The default is the prompt of the paper's figure.

    Raises:
        SettingsError: an unknown picture or measure.
    """

    picture: str | None = None
    """Attach the scene from above, with "ego" (its heading) or "north" up; None: no picture."""
    measures: tuple[str, ...] = ()
    """Criticality measures told beside the time-to-collision, of `criticality.MEASURES`."""
    beams: Beams | None = None
    """Tell only obstacles that these beams see; None: those of relevant lanes."""
    weather: str | None = None
    """Told instead of the scene's weather; "unknown" tells none."""
    templates: Templates = field(default_factory=Templates)
    """Sentences of the user's own (`Templates.load`)."""

    def __post_init__(self) -> None:
        if self.picture is not None and self.picture not in VIEWS:
            raise SettingsError(f"picture '{self.picture}': choose from {', '.join(VIEWS)}")
        for name in self.measures:
            if name not in MEASURES:
                raise SettingsError(f"measure '{name}': choose from {', '.join(MEASURES)}")
