"""Statistics on the workbench, a module a report, run by ``python -m studies.NAME``."""
