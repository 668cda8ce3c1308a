"""Wirebond's bridge as a node of rclpy."""
