"""Text of a report on the view order."""

from __future__ import annotations

from occjax.layout import Orientation, ViewOrderReport


def format_report(report: ViewOrderReport, declared: Orientation) -> str:
    """Format the consistency of the eight view orders, the best one and the disparity range."""
    lines = ["", "  mean grey difference from the centre view at the best disparity of each pixel:"]
    for name, score in sorted(report.scores.items(), key=lambda item: item[1]):
        lines.append(f"    {255 * score:7.3f} / 255  {name}{' *' * (name == report.best.name)}")
    lines.append("")
    correct = declared.then(report.best)
    if report.disorder == "serpentine":
        lines.append("view order: every second row runs backwards; pass --order serpentine")
    elif report.disorder == "grid":
        lines.append("view order: unknown, the grid or the order of the views is probably wrong")
    elif report.clearly_worse:
        flip = f" --flip {correct.flip}" if correct.flip else ""
        lines.append(f"view order: {report.best.name}; pass --order {correct.order}{flip}")
    elif report.conclusive:
        lines.append("view order: as declared")
    elif report.plausible:
        lines.append("view order: unknown, the views have too little texture or disparity")
    else:
        lines.append(
            "view order: unknown, none is clearly more consistent than the others; check the "
            "grid and the file layout, or pass a larger --max-disparity"
        )
    if report.nearer_in_front is not None:
        fraction = f"{report.nearer_in_front:.0%}"
        lines.append(f"  in {fraction} of the occlusions the nearer surface is in front")
    if report.conclusive and not report.sign_known:
        lines.append(
            "  too few occlusions to determine the sign of disparity: with rows and columns\n"
            "  flipped in addition, the views would be equally consistent"
        )
    lines += [f"views: {note}" for note in report.position_notes]
    low, high = report.disparity_range
    measured = report.measured_fraction
    source = f"from {measured:.0%} of the pixels" if measured else "not measurable, default range"
    lines.append(f"disparity: {low:.2f} to {high:.2f} pixels per view step ({source})")
    if report.at_limit:
        lines.append(
            f"  the search ended at {report.max_disparity:.2f}; if the scene has larger "
            "disparities, pass --max-disparity"
        )
    lines += [f"views: {note}" for note in report.brightness.notes]
    return "\n".join(lines)
