"""Games of several allies and several jammers on the physics of ``link``."""
