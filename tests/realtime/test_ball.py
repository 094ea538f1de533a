"""A coloured ball in pictures: its centre, and when it is not seen."""

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.realtime import ball_centre

cv2 = pytest.importorskip("cv2", reason='no OpenCV: pip install "pinadapt[camera]"')

GREEN, RED = (90.0, 150.0), (340.0, 20.0)


def drawn(centre, radius=12.0, colour=(30, 200, 60), size=(240, 160)):
    """Return a picture of a disc at a place between pixels, on grey."""
    fine = 8  # times finer
    large = np.full((fine * size[1], fine * size[0], 3), 90, dtype=np.uint8)
    place = [round(fine * (each + 0.5) - 0.5) for each in centre]
    cv2.circle(large, place, round(fine * radius), colour, -1)
    return cv2.resize(large, size, interpolation=cv2.INTER_AREA)


@pytest.mark.parametrize("centre", [(100.0, 80.0), (61.5, 90.25), (150.625, 40.875)])
def test_the_centre_is_found_to_a_tenth_of_a_pixel(centre):
    picture = drawn(centre)
    assert ball_centre(picture, GREEN) == pytest.approx(centre, abs=0.1)
    u, v = (round(each) for each in centre)
    cv2.circle(picture, (u - 4, v - 4), 3, (255, 255, 255), -1)  # a reflection
    assert ball_centre(picture, GREEN) == pytest.approx(centre, abs=0.1)
    assert ball_centre(drawn(centre, colour=(40, 30, 200)), RED) == pytest.approx(centre, abs=0.1)
    cv2.circle(picture, (20, 20), 6, (30, 200, 60), -1)  # a smaller one
    assert ball_centre(picture, GREEN) == pytest.approx(centre, abs=0.1)


def test_a_ball_that_is_not_whole_is_not_seen():
    hidden = drawn((100.0, 80.0))
    hidden[:, 100:] = 90
    others = (
        drawn((5.0, 80.0)),
        drawn((100.0, 80.0), radius=1.0),
        drawn((9.0, 9.0), colour=(90,) * 3),
    )
    for picture in (hidden, *others):
        assert ball_centre(picture, GREEN) is None
    assert ball_centre(drawn((100.0, 80.0)), RED) is None
    rgb = drawn((100.0, 80.0))[:, :, ::-1].copy()
    assert ball_centre(rgb[:, :, ::-1], GREEN) == pytest.approx((100.0, 80.0), abs=0.1)
    for wrong in (hidden.astype(float), hidden[:, :, 0], hidden[:, :, :2], hidden[:0], "picture"):
        with pytest.raises(pa.InputError, match="blue, green, red"):
            ball_centre(wrong, GREEN)
    with pytest.raises(pa.InputError, match="0 to 360"):
        ball_centre(hidden, (90.0, 400.0))
