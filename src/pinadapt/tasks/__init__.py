"""Tasks: which coordinates are controlled, and how far they are from the desired ones."""

from .frame import TASKS as TASKS
from .frame import ComTask as ComTask
from .frame import FrameTask as FrameTask
from .frame import ImageTask as ImageTask
from .frame import PoseTask as PoseTask
from .frame import PositionTask as PositionTask
from .frame import pinhole_camera as pinhole_camera
from .task import JointTask as JointTask
from .task import RowGroup as RowGroup
from .task import Task as Task
