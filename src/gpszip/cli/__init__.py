"""The command line: one module for each command, which calls the pipeline or an archive.

A command imports what it needs when it runs, so that help and ``info`` answer without the compiler.
"""
