"""The public API: arguments that do not exist."""

import pytest

import pinadapt as pa


@pytest.mark.parametrize(
    ("function", "wrong", "right"),
    [
        (pa.simulate, "durations", "duration"),
        (pa.identify, "adaption", "adaptation"),
        (pa.excite, "excursions", "excursion"),
        (pa.load, "frames", "frame"),
        (pa.make_controller, "unknwn", "unknown"),
        (pa.make_controller, "kv", "Kv"),
        (pa.make_estimator, "sensor", "sensors"),
        (pa.Limits, "torqe", "torque"),
        (pa.Unknown, "tol", "tool"),
        (pa.Engine, "substep", "substeps"),
        (pa.Camera, "rat", "rate"),
        (pa.Controller, "low", "law"),
    ],
)
def test_a_wrong_keyword_is_refused_with_the_nearest(function, wrong, right):
    with pytest.raises(pa.InputError, match=f"no argument '{wrong}'.*Did you mean '{right}'"):
        function(**{wrong: None})
