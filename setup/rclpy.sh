#!/usr/bin/env bash
# Installs a ROS 2 for the tests into a folder, by the wheels of tests/ros2/rclpy.txt:
#
#   setup/rclpy.sh PYTHON FOLDER
#
# The wheels' CMake files name the folders of Python and NumPy on the machine that built them. They get those of PYTHON,
# so that colcon can build a package of messages.
set -euo pipefail

python=$1 folder=$2
rm -rf "$folder"
"$python" -m pip install --quiet --disable-pip-version-check --no-deps --prefix "$folder" -r tests/ros2/rclpy.txt
headers=$("$python" -c 'import sysconfig; print(sysconfig.get_paths()["include"])')
numpy=$("$python" -c 'import numpy; print(numpy.get_include())')
find "$folder/share" -name '*.cmake' -exec \
  sed -i -E "s#/opt/python/[^\";]*/numpy/_core/include#$numpy#g; s#/opt/python/[^\";]*/include/python3\.[0-9]+#$headers#g" {} +
