"""Calling inner kernels, which only kernels call, from tests."""

import inspect

import numba

from gpszip.kernels.linking import OuterCompiler


def from_python(kernel):
    """A function that Python calls for an inner kernel; kernels may call it, too."""
    # Arguments have names, since the compiler takes references to tuples among these only.
    parameters = inspect.signature(kernel.py_func).parameters
    names = ", ".join(parameters)
    scope = {"kernel": kernel}
    exec(f"def call({names}): return kernel({names})", scope)
    scope["call"].__defaults__ = kernel.py_func.__defaults__
    return numba.njit(error_model="numpy", pipeline_class=OuterCompiler)(scope["call"])
