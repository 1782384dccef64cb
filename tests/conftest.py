"""Settings of all tests: how random tests run."""

import os

from hypothesis import settings

from random_tests import examples

# No deadline: the first example may wait for the compiler. Continuous integration tries the same
# examples each time, so that no change fails by chance; elsewhere new ones are tried. A run tries
# a share of them, by default and where a test says ``@examples(60)``; ``make fuzz`` tries all.
settings.register_profile(
    "gpszip",
    examples(100),
    deadline=None,
    derandomize=bool(os.environ.get("CI")),
    print_blob=True,
)
settings.load_profile("gpszip")
