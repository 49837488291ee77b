"""How the properties of the models are tried: no deadline, since kernels compile on their first call."""

from hypothesis import settings

settings.register_profile("skyway", deadline=None)
settings.load_profile("skyway")
