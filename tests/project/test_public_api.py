"""The public API: constructors refuse junk when they are called, and name the field."""

import pytest

import pinadapt as pa


@pytest.mark.parametrize(
    ("make", "junk", "field"),
    [
        (pa.Payload, {"mass": -1.0}, "payload.mass"),
        (pa.Limits, {"box": -1.0}, "limits.box"),
        (pa.Limits, {"guards": {"positon": False}}, "limits.guards"),
        (pa.Unknown, {"bodies": 3}, "unknown.bodies"),
        (pa.Engine, {"plant": "mujco"}, "engine.plant"),
        (pa.Sensors, {"camera": {"rate": 30.0}}, "sensors.camera"),
        (pa.Events, {"changes": {-1.0: None}}, "events.changes"),
        (pa.robot.Shaft, {"joints": (0, 0)}, "shafts.joints"),
    ],
)
def test_junk_is_refused_where_it_is_made(make, junk, field):
    with pytest.raises(pa.InputError) as error:
        make(**junk)
    assert error.value.where.startswith(field)


def test_scalars_are_for_all_joints():
    robot = pa.load("planar_2r").changed(friction=pa.Friction(viscous=1.0, coulomb={"joint2": 0.5}))
    assert robot.friction.viscous.tolist() == [1.0, 1.0]
    assert robot.friction.coulomb.tolist() == [0.0, 0.5]
