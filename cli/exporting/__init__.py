"""Commands about plants that leave the workbench."""
