"""List the packages of a wheel: `mmw/` and, inside it, what lies beside it in a checkout. The rest is in
pyproject.toml."""

from setuptools import find_namespace_packages, find_packages, setup

BESIDE = {"mmw.kernels": "kernels", "mmw.configs": "configs", "mmw.assets": "assets"}

packages = find_packages(include=["mmw", "mmw.*"], exclude=["mmw.kernels", "mmw.kernels.*"])
for name, folder in BESIDE.items():
    packages += [name, *(f"{name}.{inner}" for inner in find_namespace_packages(folder))]
setup(packages=packages, package_dir={"mmw": "mmw", **BESIDE})
