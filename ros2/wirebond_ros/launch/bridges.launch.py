"""Starts a bridge for each link of a file: ros2 launch wirebond_ros bridges.launch.py links:=links.yaml"""

from pathlib import Path

import yaml
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

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
    parameters = {key: link[key] for key in ("port", "baud") if key in link}
    parameters |= {key: str(path.parent / link[key]) for key in FILES if link.get(key)}
    return Node(
        package="wirebond_ros",
        executable="bridge",
        name=name,
        namespace=link.get("namespace", ""),
        parameters=[parameters],
        remappings=list(link.get("remappings", {}).items()),
        output="screen",
        respawn=True,
    )


def generate_launch_description() -> LaunchDescription:
    links = DeclareLaunchArgument("links", description="a file with the links: for each its protocol, port and mapping")
    return LaunchDescription([links, OpaqueFunction(function=nodes_of)])
