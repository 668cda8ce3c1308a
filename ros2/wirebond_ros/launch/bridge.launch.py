"""Starts the bridge: ros2 launch wirebond_ros bridge.launch.py protocol:=diffdrive.yaml port:=/dev/ttyUSB0"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

ARGUMENTS = {
    "protocol": ("", "protocol file of Wirebond (YAML); not needed where the port is wirebond://NAME"),
    "port": ("/dev/ttyUSB0", "a tty, tcp://HOST:PORT, sim: (a virtual MCU), or wirebond://NAME of a `wirebond serve`"),
    "mapping": ("", "which message is which topic; empty: ros2/FILE beside the protocol, else JSON"),
    "namespace": ("", "namespace of the node"),
}


def generate_launch_description() -> LaunchDescription:
    arguments = [
        DeclareLaunchArgument(n, default_value=value, description=text) for n, (value, text) in ARGUMENTS.items()
    ]
    # Without the type, launch reads a text as YAML: `sim:` would be a mapping, and refused.
    names = ("protocol", "port", "mapping")
    parameters = {name: ParameterValue(LaunchConfiguration(name), value_type=str) for name in names}
    node = Node(
        package="wirebond_ros",
        executable="bridge",
        name="wirebond",
        namespace=LaunchConfiguration("namespace"),
        parameters=[parameters],
        output="screen",
        respawn=True,
        respawn_delay=1.0,  # a mistake in a file would fill the log and take a core
    )
    return LaunchDescription([*arguments, node])
