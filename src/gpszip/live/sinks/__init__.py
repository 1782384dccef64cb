"""Where events go: standard output, files, webhooks and brokers, each behind ``EventSink``."""
