"""The table of an ablation: a row for each variant, a column for each metric, with intervals."""

import math


def metric_scores(
    dances: list, *, reference: list, songs: list, metrics: tuple[str, ...] = ()
) -> dict[str, dict]:
    """All metrics of `dancediff.metrics.report` and those named, as plain values.

    Returns {metric: {"value", "low", "high", "arrow", "reason"}}; low and high are None where there
    is no interval, value too where there is none, and ``reason`` says why.
    """
    from dancediff.metrics.report import evaluate_dances

    report = evaluate_dances(dances, song=songs, reference=reference, metrics=metrics)
    parts = ("value", "low", "high", "arrow", "reason")
    return {row["name"]: {part: row[part] for part in parts} for row in report.facts()["rows"]}


def table(rows: list[dict]) -> str:
    """Markdown: variants down, metrics across; a value without an interval stands alone.

    >>> fid = {"value": 3.0, "low": 2.5, "high": 4.125, "arrow": "down"}
    >>> print(table([{"variant": "full", "scores": {"FID_k": fid}},
    ...              {"variant": "no_fp", "failed": "training: out of memory"}]), end="")
    | variant | FID_k ↓ |
    | --- | --- |
    | full | 3 [2.5, 4.12] |
    | no_fp | failed |
    <BLANKLINE>
    - no_fp failed; training: out of memory
    """
    names: dict[str, str] = {}
    for row in rows:
        for name, score in row.get("scores", {}).items():
            names.setdefault(name, f"{name} {_ARROWS.get(score.get('arrow'), '')}".strip())
    lines = [["variant", *names.values()], ["---"] * (len(names) + 1)]
    notes: list[str] = []
    reasons: dict[tuple[str, str], list[str]] = {}  # which variants have a metric's reason
    for row in rows:
        if "failed" in row:
            lines.append([row["variant"], *["failed"] * len(names)])
            notes.append(f"- {row['variant']} failed; {row['failed']}")
            continue
        scores = row["scores"]
        lines.append([row["variant"], *(cell(scores.get(name)) for name in names)])
        for name, score in scores.items():
            if score.get("reason"):
                reasons.setdefault((name, score["reason"]), []).append(row["variant"])
    for (name, reason), variants in reasons.items():
        who = "all" if len(variants) == len(rows) else ", ".join(variants)
        notes.append(f"- {name} of {who}: {reason}")
    text = "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"
    return text + ("\n" + "\n".join(notes) + "\n" if notes else "")


def mean_of_seeds(rows: list[dict]) -> list[dict]:
    """One row for all seeds of a variant: the mean, from the lowest to the highest seed.

    Seeds that failed are left out; a variant without any that did not has failed.

    >>> rows = [{"variant": f"full-{k}", "of": "full", "scores": {"BAS": {"value": v}}}
    ...         for k, v in enumerate((0.2, 0.6))]
    >>> mean_of_seeds(rows)[0]["scores"]["BAS"]
    {'value': 0.4, 'low': 0.2, 'high': 0.6}
    """
    groups: dict[str, list[dict]] = {}
    for row in rows:
        groups.setdefault(row.get("of", row["variant"]), []).append(row)
    return [same[0] if "of" not in same[0] else _mean(name, same) for name, same in groups.items()]


def _mean(name: str, rows: list[dict]) -> dict:
    done = [row["scores"] for row in rows if "scores" in row]
    if not done:
        return {"variant": name, "failed": rows[0]["failed"]}
    scores = {}
    for metric in dict.fromkeys(metric for score in done for metric in score):
        found = [score[metric] for score in done if metric in score]  # not all dances have all
        known = [one["value"] for one in found if one["value"] is not None]
        interval = {"value": None, "low": None, "high": None}
        if known:
            interval = {"value": sum(known) / len(known), "low": min(known), "high": max(known)}
        scores[metric] = found[0] | interval
    return {"variant": name, "scores": scores}


_ARROWS = {"down": "↓", "up": "↑"}


def cell(score: dict | None) -> str:
    """A value and its interval.

    >>> cell({"value": 0.12345, "low": None, "high": None}), cell(None)
    ('0.123', '-')
    """
    if score is None or score["value"] is None:
        return "-"
    if math.isnan(score["value"]):
        return "nan"
    text = f"{score['value']:.3g}"
    if score.get("low") is None:
        return text
    return f"{text} [{score['low']:.3g}, {score['high']:.3g}]"
