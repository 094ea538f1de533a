"""Places in the tree that tests read."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
ARM4 = ROOT / "tests" / "data" / "arm4.urdf"  # three revolute joints and a slide
