"""The options of a calibration, under the same names as on the command line."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field, fields, replace
from typing import Any, Self

from camcal.model.lenses.base import Lens
from camcal.records import dataclass
from camcal.settings.calibration import CalibrationOptions
from camcal.solve.optimizers.base import Options as Stopping
from camcal.solve.refine import How

#: called with (what happens, details) as the work goes on
OnEvent = Callable[[str, Mapping[str, Any]], None]


@dataclass(frozen=True)
class Options(CalibrationOptions):
    """The options of a calibration, including those available only from Python."""

    refine_points: bool | None = False  #: go back to the pictures; None = where views held out gain from it
    stopping: Stopping = field(default_factory=Stopping)
    lowest: bool = (
        True  #: look for lower minima of weak cameras; a ranking of models does not, its choice does
    )

    @classmethod
    def resolve(cls, **keywords: Any) -> Self:
        """Make the options from the keywords of a call; see `Settings.resolve`."""
        own = {n: keywords.pop(n) for n in ("refine_points", "stopping", "lowest") if n in keywords}
        made = super().resolve(**keywords)
        return replace(made, **own) if own else made  # replacing converts all values once more

    @classmethod
    def of_rig(cls, asked: CalibrationOptions, **own: Any) -> Self:
        """The options of a rig that concern one camera; its model, its `fix` and other options of its own are `own`."""
        shared = {f.name: getattr(asked, f.name) for f in fields(CalibrationOptions)}
        return cls(**{n: v for n, v in shared.items() if n not in ("model", "fix")} | own)

    def how(self, lens: Lens, held: Mapping[str, float | None] | None = None) -> How:
        """The settings of every fit; `held` are parameters that the closed form had to assume."""
        fix = {**dict.fromkeys(lens.default_fixed), **(held or {}), **self.fix}
        return How(fix, self.optimizer, self.stopping, self.normalise)
