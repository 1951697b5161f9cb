"""sysid: from a robot's log to a plant you can trust."""

__version__ = "0.1.0"
