"""Guidance, control, navigation and the closed-loop mission simulator."""
