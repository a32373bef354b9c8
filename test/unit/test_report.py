"""Reports: sentences first, figures inside, readable offline by a browser."""

from __future__ import annotations

import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from synthetic_recording import COM, INERTIA_COM, MASS, held_box

from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.batch.batch import fit_recording
from tactile_dynamics_ros.core.inertia.diagnosis.term_library import CHANNELS, UNITS
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.report.discrepancy_report import (
    DiscrepancyFindings,
    write_discrepancy_report,
)
from tactile_dynamics_ros.report.estimate_report import write_estimate_report
from tactile_dynamics_ros.report.estimates import EstimateHistory, settle

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")


class _Reader(HTMLParser):
    """Collects text, images and links, and checks that tags are closed."""

    VOID = frozenset(["meta", "img", "br", "link", "hr"])

    def __init__(self, html: str) -> None:
        super().__init__()
        self.text, self.images, self.outside, self.open = "", [], [], []
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        found = dict(attrs)
        if tag not in self.VOID:
            self.open.append(tag)
        if tag == "img":
            self.images.append(found)
        self.outside += [v for k, v in attrs if k in ("src", "href") and not v.startswith("data:")]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open[-1:] != ["style"]:
            self.text += data


@pytest.fixture(scope="module")
def box():
    """Return a recording, the model fitted to it and the truth."""
    recording = held_box(seconds=8.0)
    truth = InertialParameters(MASS, COM, INERTIA_COM)
    return recording, fit_recording(recording.streams), truth


@pytest.fixture(scope="module")
def estimate_page(box, tmp_path_factory) -> Path:
    """Return the report of an estimate."""
    recording, model, truth = box
    return write_estimate_report(recording, model, tmp_path_factory.mktemp("a"), truth=truth)


@pytest.fixture(scope="module")
def discrepancy_page(tmp_path_factory) -> Path:
    """Return the report of an explanation."""
    return write_discrepancy_report(_findings(), tmp_path_factory.mktemp("b"))


def _findings() -> DiscrepancyFindings:
    random = np.random.default_rng(0)
    time = np.arange(500) / 50.0
    noise = random.normal(size=(500, 6))
    return DiscrepancyFindings(
        source="<odd & name>.mcap",
        verdict="The object drags through something viscous.",
        good=True,
        time=time,
        before=noise + np.sin(time)[:, None],
        channels=CHANNELS,
        units=UNITS,
        frame="body",
        alone="rigid body alone",
        about="The model predicts forces.",
        after=noise,
        added=["viscous_drag"],
        comparison={
            "channels": {"force x": 3.0, "force y": 1.1},
            "fails_where": [
                {"channel": "force x", "condition": "speed above 0.3 m/s", "share_of_error": 0.61}
            ],
        },
        diagnosis={
            "verdict": "ambiguous",
            "effect": "viscous_drag",
            "group": ["viscous_drag", "quadratic_drag"],
            "candidates": [
                {
                    "name": "viscous_drag",
                    "score": 900.0,
                    "p_value": 1e-30,
                    "predicted_whitened_rms": 1.02,
                    "parameters": {"c": {"value": 0.41, "std": 0.03, "unit": "N s/m"}},
                },
                {
                    "name": "force_bias",
                    "score": 10.0,
                    "p_value": 0.1,
                    "predicted_whitened_rms": 2.9,
                    "parameters": {},
                },
            ],
            "error": {"before": 3.0, "after": 1.02, "noise_floor": 1.0},
            "unexplained": {"channels": ["force x"], "frequency_hz": 12.3, "formula": None},
        },
        explanation={
            "steps": [{"added": None, "error": 3.0}, {"added": "viscous_drag", "error": 1.02}],
            "error": {"before": 3.0, "after": 1.02, "noise_floor": 1.0},
        },
        white=noise,
        conditions={"speed in m/s": np.abs(np.cos(time)), "grip force in N": time},
        intervals=[(2.0, 4.0)],
        frequency=np.linspace(0.0, 25.0, 100),
        power={"force x": random.random(100)},
    )


def test_an_estimate_report_starts_with_the_result(estimate_page):
    reader = _Reader(estimate_page.read_text())
    start = reader.text.index("The object weighs 4")
    assert start < reader.text.index("The numbers") < reader.text.index("What was measured")
    assert "a rigid body explains the measurements" in reader.text
    assert "truth" in reader.text and "400" in reader.text


def test_a_discrepancy_report_tells_the_story_in_order(discrepancy_page):
    text = _Reader(discrepancy_page.read_text()).text
    parts = [
        "<odd & name>.mcap",
        "The object drags through something viscous.",
        "The error falls from 3.00 to 1.02; noise alone leaves 1.00.",
        "What is left over",
        "This recording cannot tell viscous_drag and quadratic_drag apart",
        "c = 0.41 ± 0.03 N s/m",
        "61 % of the error of force x",
        "12.3",
    ]
    places = [text.index(part) for part in parts]
    assert places == sorted(places)


@pytest.mark.parametrize("which", ["estimate_page", "discrepancy_page"])
def test_a_report_needs_nothing_from_outside(which, request):
    page = request.getfixturevalue(which)
    reader = _Reader(page.read_text())
    assert reader.outside == []
    assert len(reader.images) >= 5
    assert all(image["alt"] for image in reader.images)
    assert page.stat().st_size < 3e6
    names = {path.stem for path in page.parent.glob("*.png")}
    assert len(names) == len(reader.images)


@pytest.mark.parametrize("which", ["estimate_page", "discrepancy_page"])
def test_a_browser_shows_all_pictures(which, request, tmp_path):
    browser = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if browser is None:
        pytest.skip(f"no browser on this machine (looked for {', '.join(BROWSERS)})")
    page = request.getfixturevalue(which)
    probe = tmp_path / "probe.html"
    script = (
        "<script>addEventListener('load', () => { document.title = 'widths ' + "
        "[...document.images].map(i => i.naturalWidth).join(' ') + ' overflow ' + "
        "(document.documentElement.scrollWidth - innerWidth); })</script></body>"
    )
    probe.write_text(page.read_text().replace("</body>", script))
    flags = ["--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path}/profile"]
    done = subprocess.run(
        [browser, *flags, "--window-size=1000,900", "--dump-dom", probe.as_uri()],
        capture_output=True,
        text=True,
        timeout=90,
        check=True,
    )
    title = done.stdout.partition("<title>")[2].partition("</title>")[0].split()
    overflow = int(title[-1])
    widths = [int(width) for width in title[1:-2]]
    assert len(widths) == page.read_text().count("<img")
    assert all(width > 400 for width in widths)
    assert overflow <= 0


def test_the_history_ends_at_the_estimate_and_narrows(box):
    recording, model, truth = box
    history = settle(model)
    estimate = model.to_estimate()
    assert history.value[-1, 0] == pytest.approx(estimate.inertia.mass, rel=1e-6)
    np.testing.assert_allclose(history.value[-1, 1:4], estimate.inertia.com, rtol=1e-6)
    np.testing.assert_allclose(history.std[-1], estimate.parameter_std, rtol=1e-6)
    quarter = len(history.time) // 4
    early = fit_recording(recording.between(0.0, history.time[quarter]).streams).to_estimate()
    difference = np.abs(history.value[quarter, :4] - [early.inertia.mass, *early.inertia.com])
    assert np.all(difference < 0.5 * history.std[quarter, :4])
    assert np.all(history.std[quarter] > 1.2 * history.std[-1])
    inside = np.abs(history.value[quarter:, 0] - truth.mass) < 3.5 * history.std[quarter:, 0]
    assert inside.mean() > 0.9


def test_a_wrist_sensor_and_an_imu_can_be_reported(tmp_path):
    time = np.arange(400) / 100.0
    from scipy.spatial.transform import Rotation

    turned = Rotation.from_rotvec(np.stack([np.sin(time), np.sin(1.7 * time), time], axis=1))
    gravity = turned.inv().apply([0, 0, -9.81])
    random = np.random.default_rng(1)
    wrist = {
        "time": time,
        "force": -0.7 * gravity + 0.01 * random.normal(size=(400, 3)),
        "torque": np.cross([0.0, 0.01, 0.05], -0.7 * gravity) + 1e-3 * random.normal(size=(400, 3)),
        "position": [0.0, 0.0, 0.0],
        "rotation": np.eye(3),
    }
    imu = {
        "time": time,
        "specific_force": -gravity + 0.01 * random.normal(size=(400, 3)),
        "rotation": turned.as_matrix(),
    }
    recording = Recording.from_arrays({"wrist": wrist}, imu=imu, contact_frame="object")
    page = write_estimate_report(recording, fit_recording(recording.streams), tmp_path)
    text = _Reader(page.read_text()).text
    assert "The object weighs 70" in text
    assert (tmp_path / "forces.png").stat().st_size > 10_000


def test_the_command_writes_the_report(box, tmp_path, capsys):
    bag = box[0].to_bag(tmp_path / "box.mcap")
    assert main(["estimate", str(bag), "--out", str(tmp_path / "out"), "--json"]) == 0
    assert "report: " in capsys.readouterr().err
    assert (tmp_path / "out" / "report.html").exists()
    (tmp_path / "file").write_text("")
    assert main(["estimate", str(bag), "--out", str(tmp_path / "file")]) == 2
    assert "is a file, expected the path of a folder" in capsys.readouterr().err


def test_a_folder_that_cannot_be_made_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInputError, match="cannot be written"):
        write_discrepancy_report(_findings(), tmp_path / "file")


def test_estimates_of_a_changed_model_replace_the_earlier_ones():
    time = np.array([1.0, 2.0, 3.0, 4.0, 1.5, 2.5, 3.5])
    value = np.arange(7.0)[:, None] * np.ones(10)
    kept = EstimateHistory(time, value, value).of_last_model()
    assert kept.time.tolist() == [1.0, 1.5, 2.5, 3.5]
    assert kept.value[:, 0].tolist() == [0.0, 4.0, 5.0, 6.0]


def test_live_estimates_are_drawn_even_before_they_settle(box, tmp_path):
    recording, model, truth = box
    time = np.arange(20.0)
    value = np.tile([0.4, *COM, 9e-4, 0.0, 7e-4, 0.0, 0.0, 5e-4], (20, 1))
    std = np.full((20, 10), np.inf)
    std[10:] = 1e-4
    live = EstimateHistory(time, value, std)
    page = write_estimate_report(recording, model, tmp_path, live, truth)
    assert "as they were published live" in page.read_text()
    none = EstimateHistory(time[:0], value[:0], std[:0])
    page = write_estimate_report(recording, model, tmp_path, none, truth)
    assert "from the first seconds to all data" in page.read_text()
