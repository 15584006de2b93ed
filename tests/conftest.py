"""No test is a test of time: examples of hypothesis may take as long as the machine makes them."""

from hypothesis import settings

settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")
