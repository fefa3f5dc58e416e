"""What every test of pictures needs."""

from deggflow.view.stage import gl_problem

gl_problem()  # chooses how MuJoCo renders, before any test module imports it
