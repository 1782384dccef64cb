"""Puts kernels compiled by ``scripts/compile_kernels.py`` into the wheel, if there are any."""

from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class CompiledKernels(BuildHookInterface):
    """A wheel with compiled kernels is for one platform and one version of Python."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add the folder ``build/compiled`` to a wheel, but not to an editable installation."""
        compiled = Path(self.root, "build", "compiled")
        if version == "standard" and compiled.is_dir():
            build_data["pure_python"] = False
            build_data["infer_tag"] = True
            build_data["force_include"][str(compiled)] = "gpszip/kernels/compiled"
