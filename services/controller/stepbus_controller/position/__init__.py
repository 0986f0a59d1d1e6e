"""`python -m stepbus_controller.position`: targets for joints with motors of their own."""
