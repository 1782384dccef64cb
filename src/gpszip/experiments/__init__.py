"""The experiments of the thesis (chapter 8), run anew beside its own numbers."""
