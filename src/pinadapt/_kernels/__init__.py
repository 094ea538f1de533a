"""The compiled functions of a control step: one formula each, stated above it, in loops.

Everything that a law, an adaptation or a model means stands in its own file; what stands here is
only how the small matrices are multiplied. See ``_compiled`` for what a kernel is.
"""
