"""Pure numerics: never imports rclpy or message packages."""
