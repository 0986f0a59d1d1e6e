"""An arm that goes from pose to pose and reports how well it holds each."""
