import numpy as np

from gpszip.kernels.compiling import on_compile
from gpszip.kernels.jit import jit


def test_compiling_is_reported_and_calling_is_not(tmp_path):
    path = tmp_path / "fresh_kernel.py"
    path.write_text("def kernel(values):\n    return values.sum()\n")
    space = {"__name__": "fresh_kernel", "__file__": str(path)}
    exec(compile(path.read_text(), str(path), "exec"), space)
    kernel = jit(space["kernel"])
    events = []

    # the first call compiles, the second does not
    with on_compile(lambda: events.append("compile")):
        kernel(np.ones(3))
        assert len(events) >= 1
        before = len(events)
        kernel(np.ones(4))
        assert len(events) == before

    # outside of the context nothing is reported
    kernel(np.ones(4, np.int64))
    assert len(events) == before
