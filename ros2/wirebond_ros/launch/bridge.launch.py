"""Starts the bridge: ros2 launch wirebond_ros bridge.launch.py protocol:=diffdrive.yaml port:=/dev/ttyUSB0"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

ARGUMENTS = {
    "protocol": ("", "protocol file of Wirebond (YAML); not needed where the port is wirebond://NAME"),
    "port": ("/dev/ttyUSB0", "a tty, tcp://HOST:PORT, or wirebond://NAME of a running `wirebond serve`"),
    "mapping": ("", "which message is which topic; empty: ros2/FILE beside the protocol, else JSON"),
    "namespace": ("", "namespace of the node"),
}


def generate_launch_description() -> LaunchDescription:
    arguments = [
        DeclareLaunchArgument(n, default_value=value, description=text) for n, (value, text) in ARGUMENTS.items()
    ]
    parameters = {name: LaunchConfiguration(name) for name in ("protocol", "port", "mapping")}
    node = Node(
        package="wirebond_ros",
        executable="bridge",
        name="wirebond",
        namespace=LaunchConfiguration("namespace"),
        parameters=[parameters],
        output="screen",
        respawn=True,
    )
    return LaunchDescription([*arguments, node])
