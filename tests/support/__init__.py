"""Small contact problems and comparisons that several test modules share."""
