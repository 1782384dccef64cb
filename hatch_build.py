"""Puts compiled kernels and man pages that ``make wheel`` has made into the wheel, if any."""

from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class CompiledKernels(BuildHookInterface):
    """A wheel with compiled kernels is for one platform and one version of Python."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add ``build/compiled`` and ``build/man`` to a wheel, not to an editable installation."""
        compiled = Path(self.root, "build", "compiled")
        if version == "standard" and compiled.is_dir():
            build_data["pure_python"] = False
            build_data["infer_tag"] = True
            build_data["force_include"][str(compiled)] = "gpszip/kernels/compiled"
        if version == "standard":
            for page in sorted(Path(self.root, "build", "man").glob("*.1")):
                build_data["shared_data"][str(page)] = f"share/man/man1/{page.name}"
