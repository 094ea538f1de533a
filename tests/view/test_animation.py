"""Animations: their size, what they show, and that pages are self-contained."""

import base64
import gzip
import json
import re
import shutil
import subprocess
from functools import cache

import pytest

from tests.support.chains import catalogue_robot
from tests.support.loops import run
from tests.support.streams import parted

pytestmark = pytest.mark.slow

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")


def stream(animation):
    """Return the messages of a page as they are in it."""
    packed = re.search(r'id="messages">([^<]*)<', animation.html).group(1)
    return gzip.decompress(base64.b64decode(packed))


def messages(animation):
    """Return the commands and notes of a page."""
    return parted(stream(animation))


@cache
def animated(name):
    """Return a short rollout and its animation."""
    rollout = run(name, duration=0.1)
    return rollout, rollout.animate()


def test_a_page_shows_both_robots_paths_and_curves():
    rollout, animation = animated("xarm7")
    commands, notes = messages(animation)
    assert ("set_object", "/meshcat/paths/true") in commands
    copies = [note["copy"] for note in notes if "copy" in note]
    shapes = catalogue_robot("xarm7").visual.geometryObjects
    assert sum(copy["ghost"] for copy in copies) == len(shapes)
    readings = [note["reading"] for note in notes if "reading" in note]
    assert readings[0]["t"] == 0.0 and readings[-1]["t"] == pytest.approx(rollout.t[-1])
    assert readings[-1]["values"][0] == pytest.approx(1e3 * rollout.distance[-1], rel=1e-3)


def browsed(page, folder):
    """Open a page in a browser of 900 x 800 pixels without a screen; return what it says."""
    return subprocess.run(
        [
            CHROMIUM,
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--use-gl=angle",
            "--use-angle=swiftshader",
            "--enable-unsafe-swiftshader",
            "--disable-quic",
            "--no-first-run",
            "--disable-background-networking",
            "--host-resolver-rules=MAP * ~NOTFOUND",
            f"--user-data-dir={folder / 'profile'}",
            "--window-size=900,800",
            "--virtual-time-budget=4000",
            "--enable-logging=stderr",
            "--dump-dom",
            page.as_uri(),
        ],
        capture_output=True,
        text=True,
        timeout=120,
    )


def check_shown(done):
    """A browser showed a page without errors, with the time and an error of the robot."""
    harmless = "ColladaLoader: File version", "GL Driver Message"  # of the software renderer
    said = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    assert not [line for line in said if not any(words in line for words in harmless)]
    assert re.search(r'id="time">t = \d\.\d s<', done.stdout)
    assert re.search(r"<b>[\d.e-]+ mm</b>", done.stdout)


# Writes where the robot, its paths and the panels are in the picture [pixels], once it is there.
MEASURED = """<script>const waits = setInterval(() => {
  if (!document.getElementById("time").textContent.startsWith("t = ")) return;
  clearInterval(waits);
  viewer.controls.update();  // as in each frame
  viewer.scene.updateMatrixWorld(true);
  const {camera, scene_tree} = viewer;
  let left = Infinity, right = -Infinity;
  camera.updateMatrixWorld();
  for (const name of ["true", "paths"])
    scene_tree.find(["meshcat", name]).object.traverse((part) => {
      const points = part.isMesh ? part.geometry.attributes.position : {count: 0};
      for (let k = 0; k < points.count; k++) {
        const point = new MeshCat.THREE.Vector3().fromBufferAttribute(points, k);
        const x = 0.5 * (1 + part.localToWorld(point).project(camera).x) * innerWidth;
        left = Math.min(left, x), right = Math.max(right, x);
      }
    });
  const panels = [...document.querySelectorAll(".panel")];
  const pixels = {left, right,
    panels: Math.max(...panels.map((one) => one.getBoundingClientRect().right)), innerWidth};
  document.body.append("MEASURED" + JSON.stringify(pixels) + "END");
}, 50)</script>"""


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_a_browser_shows_a_page_with_meshes_and_no_panel_covers_robot_or_path(tmp_path):
    page = animated("xarm7")[1].save(tmp_path / "page.html")
    page.write_text(page.read_text().replace("</body>", MEASURED + "</body>"))
    done = browsed(page, tmp_path)
    check_shown(done)
    found = re.search(r"MEASURED(\{[^}]*\})END", done.stdout)
    pixels = json.loads(found[1])
    assert pixels["innerWidth"] == 900 and pixels["panels"] > 300
    assert pixels["left"] > pixels["panels"] and pixels["right"] < 900
