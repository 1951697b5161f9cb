"""The command line of sysid; only this package prints or exits."""
