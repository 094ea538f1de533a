"""Benchmarks through the public API; never part of the tests."""
