"""The data of a figure, for its plot and its CSV."""

from dataclasses import dataclass, field

from simtune.figures.curves import Band


@dataclass(frozen=True)
class Series:
    label: str
    kind: str  # decides the colour: a method, or "authors"
    band: Band
    line: bool = True  # False: separate dots with error bars


@dataclass(frozen=True)
class Reference:
    """A constant level for comparison."""

    label: str
    value: float


@dataclass(frozen=True, kw_only=True)
class Figure:
    key: str  # name of its files
    title: str
    x_title: str
    y_title: str
    series: list[Series]
    references: list[Reference] = field(default_factory=list)
    is_ablation: bool = False  # x are values of an option, often multiples of one another
    categories: tuple[str, ...] = ()  # names of x = 0, 1, ..., if x are not numbers

    @property
    def is_empty(self) -> bool:
        return not any(series.band for series in self.series)

    def rows(self) -> list[dict[str, object]]:
        """Rows of the CSV."""
        rows: list[dict[str, object]] = []
        for series in self.series:
            for x, value in series.band:
                where = self.categories[int(x)] if self.categories else x
                rows.append({"series": series.label, self.x_title: where, **value._asdict()})
        for reference in self.references:
            rows.append({"series": reference.label, "mean": reference.value})
        return rows
