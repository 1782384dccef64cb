"""The command line: one file for each command, each a thin face of pipeline.py and archive.py.

What a command needs is imported when it runs, so that help and ``info`` answer without the compiler.
"""
