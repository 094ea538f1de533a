"""A controller on a real arm: the loop, its safety checklist, its log, and drivers of arms.

Names are imported at first use, from the list in ``__init__.pyi``: the process that writes the log
needs no controller.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
