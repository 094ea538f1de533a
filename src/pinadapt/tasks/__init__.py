"""Tasks: which coordinates are controlled, and how far they are from the desired ones."""

from .joint import JointTask as JointTask
from .pose import PoseTask as PoseTask
from .position import PositionTask as PositionTask
from .registry import TASKS as TASKS
from .registry import task_named as task_named
from .task import FrameTask as FrameTask
from .task import RowGroup as RowGroup
from .task import Task as Task
