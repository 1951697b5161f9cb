"""Physical effects that a plant model may lack: what each does, how it looks, where to start."""
