"""Records, reading them, checking them, preparing them, and designing the excitation."""
