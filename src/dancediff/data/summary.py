"""What a run of `prepare` did, and what the folder holds now, as one table."""

from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path

from dancediff.axes import FPS
from dancediff.data.take import NO_MUSIC, SPLITS

# of a retargeted take, see `dancediff.data.retarget.measure`
MEASURED = ("direction_error", "skating_source", "skating", "penetration_p95", "lowest_median")


@dataclass
class Summary:
    """What a folder holds after a run, and what the run did; ``str`` is one table."""

    folder: Path
    made: int = 0
    kept: int = 0  # were there already
    skipped: dict[str, str] = field(default_factory=dict)  # name: reason
    dropped: list[str] = field(default_factory=list)  # left the folder: they are no longer made
    counts: dict[tuple, Counter] = field(default_factory=dict)  # by (kind, music, dancers)
    measured: dict[str, list[float]] = field(default_factory=dict)  # of retargeted takes
    doubts: dict[str, list[str]] = field(default_factory=dict)  # what a person should look at

    @property
    def prepared(self) -> int:
        """Takes of this run that are in the folder now."""
        return self.made + self.kept

    def add(self, row: dict) -> None:
        """Count a take of the folder."""
        key = (row["kind"], row["music"], row["dancers"])
        count = self.counts.setdefault(key, Counter())
        count.update({"takes": 1, "frames": row["frames"], row["split"]: 1})
        if set(MEASURED) <= set(row["notes"]):
            self.measured[row["name"]] = [row["notes"][key] for key in MEASURED]
        if doubts := row["notes"].get("doubts"):
            self.doubts[row["name"]] = doubts

    def then(self, later: "Summary") -> "Summary":
        """Both runs as one, which leave the folder as the later one does."""
        return replace(
            later,
            made=self.made + later.made,
            kept=self.kept + later.kept,
            skipped=self.skipped | later.skipped,
            dropped=self.dropped + later.dropped,
        )

    @property
    def lacks(self) -> list[str]:
        """Why one cannot learn from the folder, or not as it was meant.

        >>> Summary(Path(), counts={("real", "none", 1): Counter(takes=1, val=1)}).lacks[0]
        'no take has music, so none can be trained on: data_prep/README.md says where songs lie'
        """
        takes = sum(self.counts.values(), Counter())
        found = []
        if takes and {music for _, music, _ in self.counts} == {NO_MUSIC}:
            where = "data_prep/README.md says where songs lie"
            found.append(f"no take has music, so none can be trained on: {where}")
        if takes["val"] > takes["train"]:
            why = "a few songs may fall so; prepare more"
            found.append(f"{takes['train']} takes are to train on, {takes['val']} in val: {why}")
        return found

    def facts(self) -> dict:
        """The same as plain JSON."""
        rows = [
            dict(zip(("kind", "music", "dancers"), key, strict=True)) | dict(count)
            for key, count in sorted(self.counts.items())
        ]
        facts = {"folder": str(self.folder), "made": self.made, "kept": self.kept}
        facts |= {"doubts": self.doubts} if self.doubts else {}
        facts |= {"lacks": self.lacks} if self.lacks else {}
        facts |= {"dropped": self.dropped} if self.dropped else {}
        return facts | {"skipped": self.skipped, "takes": rows, "measured": self.measured}

    def __str__(self) -> str:
        """The table, then the takes that were skipped, each with the reason."""
        lines = [f"{'motion':10} {'music':23} dancers  takes  minutes  train  val  test"]
        total: Counter = Counter()
        for (kind, music, dancers), count in sorted(self.counts.items()):
            lines.append(f"{kind:10} {music:23} {dancers:7} {_cells(count)}")
            total.update(count)
        lines.append(f"{'all':42} {_cells(total)}")
        if self.measured:
            lines += ["", f"{'take':20} degrees off  skating: source  ours  floor: p95  lowest"]
        for name, (off, source, ours, below, low) in sorted(self.measured.items()):
            lines.append(
                f"{name:20} {off:11.2f} {source:16.1%} {ours:5.1%} {below:8.3f} m {low:5.3f} m"
            )
        lines += ["", "in doubt:"] if self.doubts else []
        lines += [f"    {name}: {'; '.join(why)}" for name, why in sorted(self.doubts.items())]
        lines += ["", *self.lacks] if self.lacks else []
        lines += ["", f"made {self.made}, kept {self.kept}, skipped {len(self.skipped)}"]
        lines += [f"    {name}: {reason}" for name, reason in sorted(self.skipped.items())]
        lines += [dropped_line(self.dropped)] if self.dropped else []
        return "\n".join(lines)


def dropped_line(names: list[str]) -> str:
    """Which takes left the folder, and why.

    >>> dropped_line(["duo_0", "duo_1"])
    'dropped 2 takes, which their source no longer makes: duo_0, duo_1'
    """
    return f"dropped {len(names)} takes, which their source no longer makes: {', '.join(names)}"


def _cells(count: Counter) -> str:
    minutes = count["frames"] / FPS / 60
    train, val, test = (count[split] for split in SPLITS)
    return f"{count['takes']:6} {minutes:8.1f} {train:6} {val:4} {test:5}"
