"""motion-gym: test motion forecasters on places, sensors and crowds they were not trained on."""

__version__ = "0.1.0"
