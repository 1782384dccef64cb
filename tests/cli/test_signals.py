"""Signals that end a process."""

import ctypes
import time

import pytest

from gpszip.cli.signals import interrupt_on_signals


def test_an_interrupt_in_a_callback_is_raised_after_it():
    @ctypes.CFUNCTYPE(None)
    def callback():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), interrupt_on_signals():
        callback()
        time.sleep(30)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_other_exceptions_in_a_callback_interrupt_nothing():
    @ctypes.CFUNCTYPE(None)
    def callback():
        raise ValueError

    with interrupt_on_signals():
        callback()
        time.sleep(0.3)
