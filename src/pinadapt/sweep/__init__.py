"""Sweeps: a scenario, or a function, with many values, on all cores or a cluster, as one table.

Names are imported at first use, from the list in ``__init__.pyi``: the processes that run the cases
draw no figures.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
