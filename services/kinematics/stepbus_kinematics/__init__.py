"""One wrapper of a Pinocchio model, and what services that move joints share."""
