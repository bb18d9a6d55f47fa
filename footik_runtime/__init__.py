"""Foot IK for MuJoCo characters: feet that land, hold, roll off and never slide."""
