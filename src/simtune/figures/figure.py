"""A figure as its data: what is drawn, and what its CSV holds."""

from dataclasses import dataclass, field

from simtune.figures.curves import Band


@dataclass(frozen=True)
class Series:
    label: str
    kind: str  # by which it is coloured: a method, or "authors"
    band: Band
    line: bool = True  # or dots with error bars, each by itself


@dataclass(frozen=True)
class Reference:
    """A level to compare with."""

    label: str
    value: float


@dataclass(frozen=True, kw_only=True)
class Figure:
    key: str  # of its files
    title: str
    x_title: str
    y_title: str
    series: list[Series]
    references: list[Reference] = field(default_factory=list)
    is_ablation: bool = False  # x are values of an option, often multiples of one another
    categories: tuple[str, ...] = ()  # names of x = 0, 1, ..., where these are no numbers

    @property
    def is_empty(self) -> bool:
        return not any(series.band for series in self.series)

    def rows(self) -> list[dict[str, object]]:
        """Of the CSV."""
        rows: list[dict[str, object]] = []
        for series in self.series:
            for x, value in series.band:
                where = self.categories[int(x)] if self.categories else x
                rows.append({"series": series.label, self.x_title: where, **value._asdict()})
        for reference in self.references:
            rows.append({"series": reference.label, "mean": reference.value})
        return rows
