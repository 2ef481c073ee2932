"""The page tells of each run what its proof needs, and how certain its estimates are."""

import html
import re
from pathlib import Path

import wmr_afl
from wmr_afl.analysis.excitation import sentence
from wmr_afl.analysis.paper.report import write_report


def test_conditions_and_deviations_stand_in_the_report(tmp_path: Path) -> None:
    """Of the paper's law where its condition is broken; of least squares each estimate, and what is undetermined."""
    studies = {"study_1": wmr_afl.run("study_1"), "track_type_2_0": wmr_afl.run("track_type_2_0")}
    told = html.unescape(re.sub(r"<[^>]*>", "", write_report(studies, {}, None, tmp_path / "report.html").read_text()))
    for runs in studies.values():
        for run in runs.values():
            for one in run.conditions:
                assert f"{run.controller}: {one}" in told
                broken = f"{one}; broken in {one.share:.2%} of the samples"
                assert (broken in told) == (not one.holds)
    run = studies["track_type_2_0"]["composite"]
    assert run.deviation is not None
    for index, (name, unit) in enumerate(run.estimate_units.items()):
        last, deviation = run.estimate[-1, index], run.deviation[-1, index]
        assert f"composite: {name} = {last:.4g} ± {deviation:.2g} {unit}" in told
    assert run.undetermined
    assert f"composite: {sentence(run)}" in told
    assert "direct: pi1 =" not in told
