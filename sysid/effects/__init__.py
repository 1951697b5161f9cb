"""The catalogue of physical effects that a plant model may lack."""
