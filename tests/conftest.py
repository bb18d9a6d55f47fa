"""What all tests share."""

from hypothesis import settings

# The first example of a test may compile kernels: no deadline tells anything here.
settings.register_profile("kernels", deadline=None)
settings.load_profile("kernels")
