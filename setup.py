"""The list of packages, found; everything else of the build stands in ``pyproject.toml``.

``packages.find`` of ``pyproject.toml`` cannot rename, and two folders are installed under another
name than their own: ``cli`` as ``sysid_cli``, ``datasets`` as ``sysid_datasets``.
"""

from setuptools import find_packages, setup

setup(
    packages=[
        *find_packages(include=["sysid", "sysid.*"]),
        *(
            f"sysid_{name}"
            for name in find_packages(include=["cli", "cli.*", "datasets", "datasets.*"])
        ),
    ]
)
