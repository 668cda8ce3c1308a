"""Starts a bridge for each link of a file: ros2 launch wirebond_ros bridges.launch.py links:=links.yaml"""

from pathlib import Path

import yaml
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

FILES = ("protocol", "mapping")  # paths, as seen from the file
KEYS = (*FILES, "port", "baud", "namespace", "remappings")
EXAMPLE = "links: {base: {protocol: diffdrive.yaml, port: /dev/ttyUSB0}}"


def nodes_of(context: object) -> list[Node]:
    path = Path(LaunchConfiguration("links").perform(context))
    content = yaml.safe_load(path.read_text())
    links = content.get("links") if isinstance(content, dict) else None
    if not isinstance(links, dict) or not links:
        raise RuntimeError(f"{path} has no links; write for example `{EXAMPLE}`")
    return [_node(path, name, link) for name, link in links.items()]


def _node(path: Path, name: str, link: object) -> Node:
    where = f"{path}: the link `{name}`"
    if not isinstance(link, dict) or not link.get("port"):
        raise RuntimeError(f"{where} has no port; write for example `{EXAMPLE}`")
    if unknown := sorted(set(link) - set(KEYS)):
        raise RuntimeError(f"{where} has the key `{unknown[0]}`; possible: {', '.join(KEYS)}")
    # Without the type, launch reads a text as YAML: `sim:` would be a mapping, and refused.
    texts = {"port": str(link["port"])} | {key: str(path.parent / link[key]) for key in FILES if link.get(key)}
    parameters = {key: ParameterValue(text, value_type=str) for key, text in texts.items()}
    parameters |= {"baud": link["baud"]} if "baud" in link else {}
    return Node(
        package="wirebond_ros",
        executable="bridge",
        name=name,
        namespace=link.get("namespace", ""),
        parameters=[parameters],
        remappings=list(link.get("remappings", {}).items()),
        output="screen",
        respawn=True,
        respawn_delay=1.0,  # a mistake in a file would fill the log and take a core
    )


def generate_launch_description() -> LaunchDescription:
    links = DeclareLaunchArgument("links", description="a file with the links: for each its protocol, port and mapping")
    return LaunchDescription([links, OpaqueFunction(function=nodes_of)])
