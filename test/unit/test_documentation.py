"""What the documentation of recordings promises holds."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.docs.pages import blocks
from tactile_dynamics_ros.recording import topics
from tactile_dynamics_ros.recording.importers import IMPORTERS
from tactile_dynamics_ros.recording.importers.fields import FIELDS, UNITS

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "recordings.md").read_text()


def test_the_mapping_on_the_page_imports(tmp_path):
    for block in blocks(ROOT / "docs" / "recordings.md"):
        if block.language == "yaml":
            (tmp_path / block.name).write_text(block.text)
    rows = "\n".join(f"{10 * k},0,0,500,0,0,0,1" for k in range(50))
    (tmp_path / "tracker.csv").write_text(f"t_ms,x,y,z,qx,qy,qz,qw\n{rows}\n")
    rows = "\n".join(f"{0.01 * k + 0.008:.3f},-1,-2,-3,0.1,0,0.5,-1,0,0" for k in range(50))
    (tmp_path / "index.csv").write_text(f"t,fx,fy,fz,px,py,pz,nx,ny,nz\n{rows}\n")
    importer = next(i for i in IMPORTERS if i.name == "csv")
    recording = importer.read(tmp_path / "mapping.yaml", Namespace())
    index = recording.streams.contacts["index"]
    np.testing.assert_array_equal(index.force[0], [1.0, 2.0, 3.0])
    assert index.time[0] == pytest.approx(0.0, abs=1e-9)
    assert recording.problems == {}
    rows = "\n".join(f"{0.01 * k},{k},20,90" for k in range(50))
    (tmp_path / "tracker.csv").write_text(f"t,x,y,theta\n{rows}\n")
    rows = "\n".join(f"{0.01 * k},-1,-2,-40,20" for k in range(50))
    (tmp_path / "tip.csv").write_text(f"t,fx,fy,px,py\n{rows}\n")
    pushes = importer.read(tmp_path / "pushed.yaml", Namespace()).streams
    lean = np.array([np.sin(np.radians(3.0)), 0.0, -np.cos(np.radians(3.0))])
    np.testing.assert_allclose(pushes.gravity, 9.81 * lean, atol=1e-9)
    np.testing.assert_allclose(pushes.links[0].footprint[2], [0.04, 0.03])
    assert pushes.contacts["pusher"].force[0, 0] == pytest.approx(np.cos(np.radians(3.0)))


def test_the_page_names_all_fields_units_importers_and_topics():
    for name in FIELDS:
        assert f"`{name}`" in PAGE, name
    units = PAGE.partition("Units: ")[2].partition("The first line")[0]
    for known in UNITS.values():
        assert all(unit in units for unit in known)
    for importer in IMPORTERS:
        assert f"`{importer.name}`" in PAGE, importer.name
    for topic in (topics.OBJECT_POSE, topics.OBJECT_IMU, "/contact/<name>/force_std"):
        assert f"`{topic}`" in PAGE


def test_the_section_of_real_measurements_is_replaced_in_place(tmp_path, capsys):
    from benchmarks.page_section import replace_section
    from benchmarks.real_data import BEGIN, END, main

    section = f"{BEGIN}\nnew\n{END}\n"
    page = replace_section("# Page\n\nfirst\n", section)
    assert page == f"# Page\n\nfirst\n\n{section}"
    assert replace_section(page.replace("new", "old") + "\nlast\n", section) == page + "\nlast\n"
    assert main([str(tmp_path)]) == 2
    assert "is not on this machine" in capsys.readouterr().err


def test_a_benchmark_prints_its_outcomes_and_its_table_and_writes_its_section(tmp_path, capsys):
    from benchmarks.page_section import section_parser, show

    page = tmp_path / "page.md"
    options = section_parser("asks", 7).parse_args(["--write", str(page)])
    assert options.start == 7
    for word in ("old", "new"):
        outcomes = iter((word, "last"))
        code = show(outcomes, list, lambda f: f"<!-- b -->\n{f[0]}\n<!-- e -->\n", options.write)
        assert code == 0
    assert page.read_text() == "# Benchmarks\n\n<!-- b -->\nnew\n<!-- e -->\n"
    assert capsys.readouterr() == ("old\nlast\nnew\nlast\n",) * 2


def test_the_quick_tier_names_files_that_exist():
    names = [n for n in (ROOT / "test/quick.txt").read_text().split("\n")[1:] if n]
    assert len(names) == len(set(names)) > 100
    assert [name for name in names if not (ROOT / name).is_file()] == []
