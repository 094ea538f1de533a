"""The meshes of a robot are read once, when it is drawn; copies that are not drawn read none."""

import numpy as np
import pinocchio as pin
import pytest
from example_robot_data import robots_loader

import pinadapt as pa
from pinadapt.description.catalogue import example_geometry, example_robot


def test_loading_reads_no_mesh_and_drawing_reads_them_once(monkeypatch):
    read, built = [], pin.buildGeomFromUrdf

    def build(*arguments, **options):
        read.append(arguments)
        return built(*arguments, **options)

    monkeypatch.setattr(pin, "buildGeomFromUrdf", build)
    example_geometry.cache_clear()
    robot = pa.load("finger_edu")
    true = robot.changed(inertial_scale=2.0)
    assert not read
    assert robot.undrawn().visual is None and not read
    assert robot.visual is true.visual and len(robot.visual.geometryObjects) > 5
    assert len(read) == 1


@pytest.mark.parametrize("origin", ["talos_arm", "human", "solo8"])
@pytest.mark.slow
def test_models_equal_those_of_their_loaders(origin):
    """Armature and home pose from the SRDF, the floating base, and what special loaders add."""
    whole = robots_loader.load(origin)
    model, q_reference = example_robot(origin)
    assert np.array_equal(q_reference, whole.q0)
    arms = range(2 if robots_loader.ROBOTS[origin].free_flyer else 1, model.njoints)
    assert list(model.names) == list(whole.model.names)
    assert all(model.inertias[i] == whole.model.inertias[i] for i in arms)
    assert all(model.jointPlacements[i] == whole.model.jointPlacements[i] for i in arms)
    for field in ("armature", "effortLimit", "velocityLimit"):
        assert np.array_equal(getattr(model, field), getattr(whole.model, field))
    names = [thing.name for thing in whole.visual_model.geometryObjects]
    assert [
        thing.name for thing in example_geometry(origin, pin.GeometryType.VISUAL).geometryObjects
    ] == names
