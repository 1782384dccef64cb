import numpy as np

from gpszip.kernels.compiling import on_compile
from gpszip.kernels.jit import jit


def test_compiling_is_noticed_and_calling_is_not(tmp_path):
    path = tmp_path / "fresh_kernel.py"
    path.write_text("def kernel(values):\n    return values.sum()\n")
    space = {"__name__": "fresh_kernel", "__file__": str(path)}
    exec(compile(path.read_text(), str(path), "exec"), space)
    kernel = jit(space["kernel"])
    noticed = []
    with on_compile(lambda: noticed.append(1)):
        kernel(np.ones(3))
        assert len(noticed) >= 1
        before = len(noticed)
        kernel(np.ones(4))
        assert len(noticed) == before
    kernel(np.ones(4, np.int64))
    assert len(noticed) == before
