from glob import glob

from setuptools import setup

NAME = "wirebond_ros"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", glob("launch/*.py")),
        (f"share/{NAME}/config", glob("config/*.yaml")),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    maintainer="Wirebond maintainers",
    maintainer_email="maintainers@users.noreply.github.com",
    description="The serial link between a robot's computer and its microcontroller as a node: messages are topics",
    license="MIT",
    entry_points={"console_scripts": [f"bridge = {NAME}.bridge:main"]},
)
