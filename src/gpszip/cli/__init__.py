"""The command line: one file for each command, each a thin face of pipeline and archive.

What a command needs is imported when it runs, so that help and ``info`` answer without the compiler.
"""
