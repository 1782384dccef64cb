"""Calling inner kernels, which only kernels call, from tests."""

import numba

from gpszip.kernels.linking import OuterCompiler


def from_python(kernel):
    """A function that Python calls for an inner kernel; kernels may call it, too."""

    @numba.njit(error_model="numpy", pipeline_class=OuterCompiler)
    def call(*arguments):
        return kernel(*arguments)

    return call
