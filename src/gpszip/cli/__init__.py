"""The command line: one module for each command.

A command calls the pipeline or an archive. It imports what it needs when it runs, so that help and
``info`` answer without the compiler.
"""
