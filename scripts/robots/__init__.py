"""Robots of other packages in stepbus, compared with Pinocchio and MuJoCo used directly."""
