"""Results that are tables, in CSV: the tracked ball, the motion of the rod, the simulated jump."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, NamedTuple, Self

from jumpvision.base.record import Record, RecordError

if TYPE_CHECKING:
    import pandas as pd

    from jumpvision.base.arrays import Array


def _read_csv(file: Path) -> pd.DataFrame:
    """The table of a file, bit for bit: by default from pandas 3.1 on, which warns of the word that older ones need."""
    import pandas as pd

    exact = tuple(int(n) for n in pd.__version__.split(".")[:2]) >= (3, 1)
    return pd.read_csv(file) if exact else pd.read_csv(file, float_precision="round_trip")


def _write_csv(table: pd.DataFrame, file: Path) -> None:
    # pandas makes a text of each number before it writes: 20 MB at once for 20,000 rows of a track
    table.to_csv(file, index=False, lineterminator="\n", chunksize=1000)


@dataclass(frozen=True)
class Table(Record):
    """A CSV table; floats are written so that they read back bit for bit."""

    table: pd.DataFrame
    columns: ClassVar[tuple[str, ...]]

    further: ClassVar[tuple[str, ...]] = ()  # columns that are not in every file

    def __post_init__(self) -> None:
        missing = [c for c in self.columns if c not in self.table.columns]
        if missing:
            raise RecordError(f"{self.file}: columns missing: {missing}")

    def save(self, folder: Path) -> None:
        _write_csv(self.table, folder / self.file)

    @classmethod
    def load(cls, folder: Path) -> Self:
        return cls(_read_csv(folder / cls.file))


@dataclass(frozen=True)
class Track(Table):
    """Rod marker, one row a frame; times at mid-exposure; a flagged row holds NaN. others: the same of further balls,
    in track_2.csv, track_3.csv ..."""

    others: tuple[pd.DataFrame, ...] = ()

    file = "track.csv"
    further = (
        *("sigma_common_m", "exposure_shift_m", "exposure_shift_sigma_m", "lens_m"),
        *("x_m", "y_m"),  # where [rod_video] origin is given
        *("corrected", "x_found_px", "y_found_px", "flag_found"),  # where [rod_corrections] is given
    )
    columns = ("frame", "time_s", "x_px", "y_px", "sigma_px", "height_m", "sigma_m", "flag")

    def save(self, folder: Path) -> None:
        super().save(folder)
        for k, table in enumerate(self.others, 2):
            _write_csv(table, folder / f"track_{k}.csv")

    @classmethod
    def load(cls, folder: Path) -> Self:
        first = super().load(folder).table
        files = sorted(folder.glob("track_[0-9]*.csv"), key=lambda f: int(f.stem[6:]))
        return cls(first, tuple(_read_csv(f) for f in files))

    @property
    def good(self) -> pd.DataFrame:
        """The rows without a flag."""
        flag = self.table.flag
        return self.table[flag.isna() | (flag.astype(str) == "")]


class BesideModel(NamedTuple):
    """A rod and its model, heights above rest, arrays: measured at t (n,) [s] as h [m] with all of its standard
    uncertainty sigma [m]; the model at the same times; its own course model_h (m,) [m] at model_t [s]."""

    t: Array
    h: Array
    sigma: Array
    model: Array
    model_t: Array
    model_h: Array

    @property
    def difference(self) -> Array:
        """Measured minus model [m], (n,)."""
        return self.h - self.model


class Profiles(Table):
    """A steady flow along lines, a row a place; units as in statistics.nc."""

    file = "profiles.csv"
    columns = ("line", "s", "x", "y", "along", "across", "u", "v")


class RodMotion(Table):
    """Height of the rod [m] against time, zero at rest, only where it is known.

    sigma_m is all of a height's standard uncertainty, sigma_common_m the part that other recordings share; lens_m the
    signed change of the height by one standard uncertainty of the lens' k1, where that is stated; corrected is 1 where
    a person said where the ball is.
    """

    file = "rod.csv"
    columns = ("time_s", "height_m", "sigma_m")
    further = ("sigma_common_m", "lens_m", "corrected")

    @property
    def arrays(self) -> tuple[Array, Array, Array]:
        """time [s], height [m] and the independent part of sigma [m], by which fits weight, as numpy arrays."""
        from jumpvision.estimate.estimate import independent

        time, height, sigma = (self.table[c].to_numpy(float) for c in self.columns)
        return time, height, independent(sigma, self.common)

    def beside(self, model: Simulation) -> BesideModel:
        """This rod and its model, of which the first sample is at rest."""
        import numpy as np

        t, h, sigma = (self.table[c].to_numpy(float) for c in self.columns)
        model_t, rod = (model.table[c].to_numpy(float) for c in ("time_s", "rod_m"))
        height = rod - rod[0]
        return BesideModel(t, h, sigma, np.interp(t, model_t, height), model_t, height)

    @property
    def common(self) -> Array:
        """The part of sigma [m] that other recordings share, (n,); zeros in a file from before it was stated."""
        return self._further("sigma_common_m")

    @property
    def lens(self) -> Array:
        """Signed change of each height [m] by one standard uncertainty of k1, (n,); zeros where it is exact."""
        return self._further("lens_m")

    @property
    def scale_share(self) -> float:
        """Relative standard uncertainty of all heights above rest (scale and tilt), from the one farthest from rest."""
        import numpy as np

        from jumpvision.estimate.estimate import independent

        height = np.abs(self.table.height_m.to_numpy(float))
        far = int(np.argmax(height))
        by_scale = independent(self.common, np.abs(self.lens))[far]
        return float(by_scale / height[far]) if height[far] > 0.0 else 0.0

    def _further(self, column: str) -> Array:
        import numpy as np

        return self.table[column].to_numpy(float) if column in self.table else np.zeros(len(self.table))


class Simulation(Table):
    """The simulated jump at the measured times: x_r, x_f, x_m [m] absolute (x up), forces [N]."""

    file = "simulation.csv"
    columns = ("time_s", "rod_m", "foot_m", "motor_m", "ground_N", "spring_N")
