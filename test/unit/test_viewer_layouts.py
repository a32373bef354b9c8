"""Layouts for RViz, Foxglove and PlotJuggler name topics, services and fields that exist."""

import json
import re
from pathlib import Path
from xml.etree import ElementTree

import yaml

from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import PARAMETER_NAMES
from tactile_dynamics_ros.ros import names
from tactile_dynamics_ros.share import share_file

LAYOUTS = Path(share_file("config/layouts/foxglove.json")).parent
KNOWN = {f"/{value.lstrip('/')}" for value in vars(names).values() if isinstance(value, str)}
KNOWN |= {f"/{names.contact_topic(contact, 'force')}" for contact in names.CONTACTS}
FIELDS = {*PARAMETER_NAMES, *(f"{name}_std" for name in PARAMETER_NAMES)}


def topic_of(path):
    """Return the known topic that a path of a field begins with."""
    return next((topic for topic in KNOWN if re.match(re.escape(topic) + r"[./]", path)), None)


def test_rviz_listens_to_topics_that_exist():
    layout = yaml.safe_load((LAYOUTS / "tactile_dynamics.rviz").read_text())
    manager = layout["Visualization Manager"]
    assert manager["Global Options"]["Fixed Frame"] == "world"
    topics = [
        display[key]["Value"]
        for display in manager["Displays"]
        for key in ("Topic", "Description Topic")
        if key in display
    ]
    assert {"object/markers", "object/pose", "robot_description"} <= set(topics)
    assert {f"/{topic}" for topic in topics} <= KNOWN


def test_foxglove_names_topics_services_and_fields_that_exist():
    text = (LAYOUTS / "foxglove.json").read_text()
    layout = json.loads(text)["configById"]
    panels = set(re.findall(r'"(\w+!\w+)"', json.dumps(json.loads(text)["layout"])))
    assert panels == set(layout)
    paths = [p["value"] for panel in layout.values() for p in panel.get("paths", ())]
    assert all(topic_of(path) for path in paths), paths
    assert set(re.findall(r'key=="(\w+)"', " ".join(paths))) <= FIELDS
    assert layout["CallService!diagnose"]["serviceName"] in KNOWN


def test_plotjuggler_names_fields_that_exist():
    root = ElementTree.parse(LAYOUTS / "plotjuggler.xml").getroot()
    curves = [curve.attrib["name"] for curve in root.iter("curve")]
    assert len(curves) >= 8 and all(topic_of(curve) for curve in curves), curves
    told = [curve.rpartition("/")[2] for curve in curves if "/parameters/" in curve]
    assert told and set(told) <= FIELDS
