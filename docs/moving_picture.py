"""The moving picture of the README: a quadruped that crawls with an unknown load.

``python docs/moving_picture.py`` simulates the loop, draws its page frame by frame in headless
Chromium, and writes docs/crawl.gif. It needs Chromium or Chrome; Pillow and tornado, which it
imports too, are installed with matplotlib and meshcat. ``--page FILE`` keeps the page as well.
"""

from __future__ import annotations

import argparse
import asyncio
import base64
import io
import json
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import numpy as np
from PIL import Image
from tornado.websocket import WebSocketClientConnection, websocket_connect

import pinadapt as pa
from pinadapt.trajectories import Crawl

PICTURE = Path(__file__).parent / "crawl.gif"
FEET = ["FL_foot", "FR_foot", "RL_foot", "RR_foot"]
FRAMES_PER_SECOND = 12.0  # of the picture
SIZE = 760, 440  # [pixels]
COLOURS = 255

FLAGS = (
    "--headless",
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--hide-scrollbars",
    "--remote-debugging-port=0",
)
READY = "typeof viewer === 'object' && viewer.animator.duration > 0"
# The robot is right of the panels, on a plain background; only the first curves are shown.
LAYOUT = """
  document.head.insertAdjacentHTML("beforeend", `<style>
    .dg.main, #curves > :nth-child(n + 5) { display: none }
  </style>`);
  for (const end of ["top_color", "bottom_color"])
    viewer.set_property(["Background"], end, [0.95, 0.96, 0.97]);
  viewer.camera.zoom = 1.12;
  viewer.camera.setViewOffset(innerWidth, innerHeight, -150, 0, innerWidth, innerHeight);
"""
SHOW = """(async () => {
  const drawn = () => new Promise(requestAnimationFrame);
  viewer.animator.pause();
  viewer.animator.display_progress(%f);
  viewer.animator.seek(%f);
  await drawn();  // the page draws the path up to that time
  viewer.set_dirty();
  await drawn();
  await drawn();
})()"""


def rollout() -> pa.Rollout:
    """Return the run: four steps with a load of 6 kg on the trunk that nobody announced."""
    robot = pa.load("a1", base="free", contacts=FEET)
    true = robot.changed(payload=pa.Payload(mass=6.0, com=(0.05, 0.02, 0.08)))
    controller = pa.make_controller(robot, unknown="payload")
    crawl = Crawl(steps=4, length=0.08, height=0.06).on(robot)
    return pa.simulate(
        true, controller, crawl, duration=crawl.settles, engine="mujoco", title="A1, 6 kg unknown"
    )


def installed_browser() -> str | None:
    """Return the program of Chromium or Chrome, or None."""
    return next(filter(None, map(shutil.which, ("chromium", "google-chrome"))), None)


@contextmanager
def browser(page: Path) -> Iterator[str]:
    """Open a page in Chromium; yield the address that takes its commands."""
    program = installed_browser()
    if program is None:
        raise SystemExit("Chromium or Chrome is needed.")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        command = [program, *FLAGS, f"--user-data-dir={profile}", page.as_uri()]
        process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
        try:
            yield address_of(Path(profile) / "DevToolsActivePort", process)
        finally:
            process.terminate()
            process.wait()


def address_of(port: Path, process: subprocess.Popen[bytes]) -> str:
    """Return the address of a browser's page; the browser writes its port into a file."""
    while process.poll() is None:
        if port.exists() and (words := port.read_text().split()):
            with urlopen(f"http://127.0.0.1:{words[0]}/json/list") as answer:
                tabs = [tab for tab in json.load(answer) if tab["type"] == "page"]
            if tabs:
                return tabs[0]["webSocketDebuggerUrl"]
        time.sleep(0.2)
    raise SystemExit(f"The browser ended with status {process.returncode}.")


class Tab:
    """A page that takes commands, one at a time."""

    def __init__(self, connection: WebSocketClientConnection) -> None:
        """Take the connection to the page."""
        self._connection, self._count = connection, 0

    async def command(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command of Chromium's protocol and return its result."""
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        await self._connection.write_message(json.dumps(message))
        while (text := await self._connection.read_message()) is not None:
            answer = json.loads(text)
            if answer.get("id") == self._count:
                return answer["result"]
        raise SystemExit("The browser is gone.")

    async def value(self, expression: str) -> Any:
        """Return the value of an expression or of its promise."""
        answer = await self.command(
            "Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True
        )
        return answer["result"].get("value")


async def frames(
    address: str, times: Iterable[float], size: tuple[int, int] = SIZE, layout: str = LAYOUT
) -> list[Image.Image]:
    """Return pictures of a page at the given times [s], after a script that changes its layout."""
    tab = Tab(await websocket_connect(address, max_message_size=2**27))
    width, height = size
    await tab.command(
        "Emulation.setDeviceMetricsOverride",
        width=width,
        height=height,
        deviceScaleFactor=1,
        mobile=False,
    )
    while not await tab.value(READY):
        await asyncio.sleep(0.2)
    await tab.value(layout)
    pictures = []
    for t in times:
        await tab.value(SHOW % (t, t))
        shot = await tab.command("Page.captureScreenshot", format="png")
        pictures.append(Image.open(io.BytesIO(base64.b64decode(shot["data"]))).convert("RGB"))
    return pictures


def write(pictures: list[Image.Image], path: Path) -> None:
    """Write an endless GIF with one palette for all frames, so that constant areas cost nothing."""
    some = pictures[:: max(len(pictures) // 6, 1)]
    sheet = Image.new("RGB", (SIZE[0], SIZE[1] * len(some)))
    for k, picture in enumerate(some):
        sheet.paste(picture, (0, k * SIZE[1]))
    palette = sheet.quantize(COLOURS, method=Image.Quantize.FASTOCTREE)
    first, *rest = (p.quantize(palette=palette, dither=Image.Dither.NONE) for p in pictures)
    first.save(
        path,
        save_all=True,
        append_images=rest,
        duration=round(1000 / FRAMES_PER_SECOND),
        loop=0,
        optimize=True,
    )


def main() -> None:
    """Run, draw and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--page", type=Path, help="keep the page here")
    options = parser.parse_args()
    run = rollout()
    print(run)
    with tempfile.TemporaryDirectory() as folder:
        page = run.animate().save((options.page or Path(folder) / "page.html").resolve())
        times = np.arange(0.0, run.t[-1], 1.0 / FRAMES_PER_SECOND)
        with browser(page) as address:
            pictures = asyncio.run(frames(address, times))
    write(pictures, PICTURE)
    print(f"{PICTURE}: {len(pictures)} frames, {os.path.getsize(PICTURE) / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
