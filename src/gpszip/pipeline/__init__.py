"""The use cases: compress, append, merge, match, patch, follow live, and make coresets.

Nothing here prints. A caller that wants to show progress passes a listener, which receives
:class:`~gpszip.model.report.Progress` events.
"""
