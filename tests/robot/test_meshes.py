"""The meshes of a robot are read once, when it is drawn; copies that are not drawn read none."""

import pinocchio as pin

import pinadapt as pa
from pinadapt.description.catalogue import whole_geometry


def test_loading_reads_no_mesh_and_drawing_reads_them_once(monkeypatch):
    read = []
    built = pin.buildGeomFromUrdfString

    def build(*arguments, **options):
        read.append(arguments)
        return built(*arguments, **options)

    monkeypatch.setattr(pin, "buildGeomFromUrdfString", build)
    whole_geometry.cache_clear()
    robot = pa.load("finger_edu")
    true = robot.changed(inertial_scale=2.0)
    assert not read
    assert robot.undrawn().visual is None and not read
    assert robot.visual is true.visual and len(robot.visual.geometryObjects) > 5
    assert len(read) == 1
