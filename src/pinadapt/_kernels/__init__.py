"""The compiled functions of a control step: one formula each, stated above it, in loops.

Laws, adaptations and models are explained in their own files; here are only the products of their
small matrices. See ``_compiled`` for what a kernel is.
"""
