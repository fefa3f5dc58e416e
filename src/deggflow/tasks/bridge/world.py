"""Dimensions of workspace, gap, plank and robots, in metres (paper, App. on Task 1)."""

X_MIN, X_MAX = -7.0, 6.8  # m, workspace
Y_MIN, Y_MAX = -3.0, 3.0  # m
GAP_LEFT, GAP_RIGHT = 0.0, 2.0  # m, edges of the gap; robots start left of it
PLANK_LENGTH, PLANK_WIDTH = 5.8, 0.72  # m
ROBOT_RADIUS = 0.16  # m, robots are disks
SUPPORT = 0.55  # m of plank that must lie on the ground on either side of the gap
CORRIDOR = 0.05  # m by which the path of the robots' centres must reach beyond each edge
END_CLEARANCE = 0.075  # m kept by a crossing robot's disk from the plank's ends
ROBOT_GOALS_MIN = 3.2  # m, least x of the region in which robots have their goals

CONTACT_SIDE = PLANK_WIDTH / 2  # m, contact points lie on the long edges
CENTRE_SIDE = CONTACT_SIDE + ROBOT_RADIUS  # m, a robot touches from outside
CONTACT_SPACING = 0.38  # m, least distance of contact points on one side
CONTACT_X_MIN, CONTACT_X_MAX = -2.65, -0.1  # m, where contact points are drawn along the plank

DT = 0.2  # s, one action
HORIZON = 20  # actions of a generated policy
EXECUTED = 4  # of them executed before the next policy is generated
COEFFICIENTS = 8  # of the B-spline, K
AGENT_DIM = 3 * COEFFICIENTS  # of a robot's generative state

LINEAR_SPEED = 0.44  # m/s, plank
ANGULAR_SPEED = 0.32  # rad/s, plank
ROBOT_SPEED = 0.86  # m/s, at a contact point

MIN_ROBOTS, MAX_ROBOTS = 2, 8
