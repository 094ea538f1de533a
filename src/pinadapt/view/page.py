"""One web page: meshcat's viewer, the commands its server would have sent, and a legend.

No server is started. A page stands in for the window of a ``meshcat.Visualizer`` and keeps the
commands; in the browser they are unpacked and handed to the viewer in their order.
"""

from __future__ import annotations

import gzip
import json
from base64 import b64encode
from collections.abc import Mapping
from html import escape
from pathlib import Path
from string import Template
from typing import Any

import meshcat
import umsgpack
from meshcat.geometry import Material

from ..exceptions import PinadaptError
from .camera import Camera


class Page:
    """A window without a server, for ``meshcat.Visualizer(window=page)``."""

    def __init__(self) -> None:
        """Start empty."""
        self._commands: list[bytes] = []
        self._ghosts: list[tuple[str, str]] = []
        self._revealed: list[str] = []

    def send(self, command: Any) -> None:
        """Keep a meshcat command."""
        self._commands.append(umsgpack.packb(command.lower(), force_float_precision="single"))

    def show_as_ghost(self, source: str, target: str) -> None:
        """Show the object of one path at another one as well, in the ghost's material."""
        self._ghosts.append((source, target))

    def reveal(self, path: str) -> None:
        """Show the object of a path, a mesh, as far as the animation has come."""
        self._revealed.append(path)

    def html(self, title: str, legend: Mapping[str, int], camera: Camera, ghost: Material) -> str:
        """Return the page.

        Args:
            title: shown above the legend.
            legend: text -> colour.
            camera: from where to look.
            ghost: material of ghosts objects.

        Raises:
            PinadaptError: meshcat's viewer is missing or speaks another language.
        """
        framed = b"".join(len(command).to_bytes(4, "big") + command for command in self._commands)
        scene = {
            "target": camera.target.tolist(),
            "direction": camera.direction.tolist(),
            "box": camera.box.tolist(),
            "ghost": ghost.lower({}),
            "ghosts": self._ghosts,
            "revealed": self._revealed,
        }
        rows = (
            f'<div><i style="background:#{colour:06x}"></i>{escape(text)}</div>'
            for text, colour in legend.items()
        )
        return _PAGE.substitute(
            title=escape(title),
            legend="".join(rows),
            viewer=_viewer(),
            commands=b64encode(gzip.compress(framed, compresslevel=6, mtime=0)).decode("ascii"),
            scene=json.dumps(scene),
        )


def _viewer() -> str:
    """Return the source of meshcat's viewer for browsers."""
    path = Path(meshcat.__file__).parent / "viewer" / "dist" / "main.min.js"
    try:
        source = path.read_text(encoding="utf-8")
    except OSError as reason:
        raise PinadaptError(
            f"meshcat's viewer cannot be read: {reason}. Reinstall meshcat (0.3.2 or later)."
        ) from reason
    if "handle_command_bytearray" not in source:
        raise PinadaptError(f"the viewer in {path} is of an unknown kind. Install meshcat 0.3.2.")
    return source


_PAGE = Template("""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<title>$title</title>
<style>
  body { margin: 0; overflow: hidden; font: 14px/1.6 system-ui, sans-serif; color: #222; } #scene {
  width: 100vw; height: 100vh; overflow: hidden; } #legend { position: absolute; left: 14px; top:
  10px; padding: 8px 14px; border-radius: 6px; background: #ffffffc0;
            pointer-events: none; }
  #legend i { display: inline-block; width: 20px; height: 8px; border-radius: 4px; margin-right:
  8px; }
</style>
</head>
<body>
<div id="scene"></div>
<div id="legend"><b>$title</b>$legend<div id="time">loading</div></div>
<script>$viewer</script>
<script type="text/plain" id="commands">$commands</script>
<script type="application/json" id="settings">$scene</script>
<script>
  const text = (id) => document.getElementById(id).textContent;
  const settings = JSON.parse(text("settings"));
  const viewer = new MeshCat.Viewer(document.getElementById("scene"));

  function object(path) {
    return viewer.scene_tree.find([...path.split("/").filter((word) => word), "<object>"]).object;
  }

  function look() {  // the viewer's own axes have y upwards
    const upwards = ([x, y, z]) => new MeshCat.THREE.Vector3(x, z, -y); const half = Math.tan(15 *
    Math.PI / 180); const [right, up, forward] = settings.box; const distance = forward +
    Math.max(up, right * innerHeight / innerWidth) / half; viewer.camera.fov = 30;
    viewer.camera.near = distance / 100; viewer.camera.far = 50 * distance;
    viewer.controls.target.copy(upwards(settings.target));
    const towards = upwards(settings.direction).multiplyScalar(distance);
    viewer.camera.position.copy(towards).add(viewer.controls.target);
  }

  function showGhosts() {
    const material = new MeshCat.THREE.MaterialLoader().parse(settings.ghost);
    for (const [source, target] of settings.ghosts) {
      const twin = object(source).clone();
      twin.material = material;
      viewer.set_object(target.split("/").filter((word) => word), twin);
    }
  }

  function tick() {
    const {time, duration} = viewer.animator;
    document.getElementById("time").textContent = "t = " + time.toFixed(1) + " s";
    for (const path of settings.revealed) {
      const {index, drawRange} = object(path).geometry; drawRange.count = duration > 0 ? 3 *
      Math.round(index.count / 3 * time / duration) : index.count;
    }
    requestAnimationFrame(tick);
  }

  async function show() {
    if (typeof DecompressionStream === "undefined") throw new Error("this page needs a browser of
    2023 or later"); const packed = await fetch("data:application/octet-stream;base64," +
    text("commands")); const bytes = await new Response(packed.body.pipeThrough(new
    DecompressionStream("gzip"))).arrayBuffer(); const view = new DataView(bytes); for (let at = 0,
    size; at < bytes.byteLength; at += 4 + size) {
      size = view.getUint32(at);
      viewer.handle_command_bytearray(new Uint8Array(bytes.slice(at + 4, at + 4 + size)));
    }
    showGhosts();
    look();
    viewer.set_dirty();
    tick();
  }
  show().catch((error) => { document.getElementById("time").textContent = error.message; });
</script>
</body>
</html>
""")
