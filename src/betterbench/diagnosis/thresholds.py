"""Thresholds of the diagnosis alone, each with its unit, its reason and the effect of changing it.

What the diagnosis shares with live judging (the goal tracker, grasp attempts, harm) stands in
:mod:`betterbench.tasks.thresholds`, with the thresholds of halts, falls, collisions and slips that every run lists in
its conventions. A tolerance of a relation stands in the file of its relation.

Entries that are not listed decided before they stood here: see :func:`betterbench.tasks.thresholds.threshold`.
"""

from betterbench.tasks.thresholds import THRESHOLDS, threshold

# fmt: off
# Between a grasp and its target.
DOUBT = threshold("doubt", 0.03, "m",
    "Distance by which what was asked for may be farther from a gripper that closed on nothing than something else "
    "is, for the miss to be one of what was asked for: a bad aim proves no wrong choice.",
    "Larger: more misses are of what was asked for; more execution_failure, fewer wrong_object and "
    "behavioral_inertia.")
BETWEEN = threshold("between", 0.02, "m",
    "Distance by which something else may be farther from a gripper that closed on nothing than what was asked for "
    "is, for the closing to be between the two, so that it cannot be told which was meant; the noise of a closing "
    "point.",
    "Larger: more misses are between two objects; more execution_failure without a first attempt that counts, fewer "
    "wrong_object.")
SQUEEZES = threshold("squeezes", 3, "1",
    "Times that fingers close by a little around what is asked for and open again from which they have tried to "
    "take it; once or twice may be a flicker of the command.",
    "Larger: fewer closings in part are tries; fewer execution_failure of a weak grip, more timeout.")
TRIES_IN_VAIN = threshold("tries_in_vain", 3, "1",
    "Times that a gripper has closed on the right thing and lost it or let go of it too early from which it fails, "
    "though it has it once more when the limit comes; honest policies did so at most twice.",
    "Larger: more tries are forgiven if the last one holds the object; fewer execution_failure, more timeout.")
MEMORIZED_SPOT = threshold("memorized_spot", 0.04, "m",
    "Distance from where a target would have taken something, if it stood where training had it, up to which that "
    "was put there; slots vary by 15 mm a side and placements by as much.",
    "Larger: more objects were put where training had the target; more behavioral_inertia, fewer execution_failure.")

# Stays: what an empty gripper is over.
OVER_HEIGHT = threshold("over_height", 0.12, "m",
    "Height above the top of an object up to which an open gripper is over it; grasps from above begin there.",
    "Larger: the gripper is over objects from higher up; more wrong_object and semantic_feature_collapse by a stay, "
    "fewer phase_conflict and timeout.")
BESIDE = threshold("over_beside", 0.01, "m",
    "Distance beside a thing, seen from above, up to which an open gripper is over it.",
    "Larger: the gripper is over objects from farther beside them; more wrong_object and semantic_feature_collapse "
    "by a stay, fewer phase_conflict and timeout.")
STAY_TIME = threshold("stay_time", 2.0, "s",
    "Time that an open gripper stays over something, in all, until it has chosen it. Honest policies of the "
    "independent family stay over something else for up to 4 s, but grasp then, and are judged by the grasp.",
    "Larger: fewer stays choose an object; fewer wrong_object and semantic_feature_collapse, more timeout.")
STAY_SHARE = threshold("stay_share", 0.7, "1",
    "Share of the time over things that is spent over one of them if that one is chosen; less is to and fro.",
    "Larger: a stay chooses only what it is over nearly all the time; fewer wrong_object, more phase_conflict and "
    "timeout.")
PASSING = threshold("passing", 0.08, "m",
    "Distance between the places where the gripper comes over something and leaves it again from which it only "
    "passes.",
    "Larger: fewer ways over an object are passing; more wrong_object and semantic_feature_collapse by a stay, "
    "fewer timeout.")
PASSING_AT_END = threshold("passing_at_end", 0.25, "1",
    "Share of passing that a gripper which is still over something at the end must have gone there to be passing "
    "it; it had no time to leave.",
    "Larger: more stays at the end count; more wrong_object by a stay, fewer timeout.",
    listed=False)
STRAIGHT = threshold("straight", 0.8, "1",
    "Distance from begin to end over the length of a way from which it goes straight on; to and fro has less.",
    "Larger: fewer ways at the end are passing; more wrong_object by a stay, fewer timeout.",
    listed=False)
RETREAT = threshold("retreat", 0.15, "m",
    "Distance from where an open gripper was over something by which it has gone away from it, until it comes back.",
    "Larger: fewer returns count; fewer phase_conflict, more timeout.")
RETURNS = threshold("returns", 3, "1",
    "Times that an open gripper comes over the right thing, and goes away in between, from which it goes to and "
    "fro. None of 645 honest trials of the independent family did so even twice before its first grasp.",
    "Larger: more returns are forgiven; fewer phase_conflict, more timeout.")
COMES_DOWN = threshold("comes_down", 0.035, "m",
    "Height over the foot of a flat object up to which a gripper has come down to it; plates, slices and cutlery "
    "are lower than the fingers that take them, so that the tool center point is above their top when it takes "
    "them.",
    "Larger: the gripper has come down to flat objects earlier; more timeout of a gripper that does not close, "
    "fewer phase_conflict.")
FLICKER_TIME = threshold("flicker_time", 0.25, "s",
    "Time up to which an interruption of a contact, a stay or a grip is none: contacts and places tremble.",
    "Larger: more interruptions are none; fewer phase_conflict and execution_failure that need several separate "
    "times, more wrong_object by a stay.",
    listed=False)

# Pushes, and failed ways of taking the right object.
PUSH_TRAVEL = threshold("push_travel", 0.08, "m",
    "Distance over which an empty gripper moves something in front of it that is a push and no slip; honest "
    "policies of the independent family moved nothing by more than 1 cm without grasping it, in 297 trials.",
    "Larger: fewer touches are pushes; fewer wrong_object and execution_failure by a push, more timeout.")
PUSH_SHARE = threshold("push_share", 0.5, "1",
    "Share of push_travel that the gripper has to go itself for a push, and that an object has to move to be shoved "
    "aside; what rolls off goes farther than what moved it.",
    "Larger: fewer touches are pushes or shoves; fewer wrong_object and execution_failure by a push, more "
    "phase_conflict and timeout.",
    listed=False)
PUSH_GAP = threshold("push_gap", 1.0, "s",
    "Time between two touches up to which they are one push: what slides ahead of a gripper is touched now and "
    "then, and goes on sliding for a moment.",
    "Larger: more touches are one push; fewer objects that are moved several times, so fewer wrong_object and "
    "execution_failure by a push.")
PUSH_ALONG = threshold("push_along", 0.8, "1",
    "Cosine of the angle between the ways of gripper and object from which one pushes the other.",
    "Larger: a push has to go more nearly the gripper's way; fewer wrong_object and execution_failure by a push.")
PUSH_AGAIN = threshold("push_again", 3, "1",
    "Times that an empty gripper comes to a thing and moves it from which it goes for it, also where the thing "
    "rolls off or falls over and takes another way than the gripper.",
    "Larger: fewer objects are pushed by being moved again and again; fewer wrong_object and execution_failure, "
    "more timeout.")
SHOVED_AGAIN = threshold("shoved_again", 2, "1",
    "Times that an empty gripper moves the right thing aside from which it fails to take it, if it never grasps it. "
    "A wrong thing is gone for where it is moved more often, or pushed: an arm may run into it on its way.",
    "Larger: more shoves are forgiven; fewer execution_failure, more timeout.")
BEGINS_TO_MOVE = threshold("begins_to_move", 0.002, "m",
    "Distance from where it stood from which a touched object moves; contacts let things tremble by less.",
    "Larger: pushes begin later, so that other evidence comes first more often; fewer wrong_object by a push.",
    listed=False)
CLOSED_IN_PART = threshold("closed_in_part", THRESHOLDS.finger_travel, "m",
    "Least travel of fingers that close around something without touching it, for a grasp that was meant; they are "
    "brought to the width of a thing before they come down to it.",
    "Larger: fewer closings in part are meant as grasps; fewer execution_failure, more timeout.")
RUNS_INTO = threshold("runs_into", 3, "1",
    "Times that an open gripper comes down and runs into the right thing, and rises again, from which it tries in "
    "vain to take it. Who is slow on the right way runs into nothing.",
    "Larger: more runs into the right object are forgiven; fewer execution_failure, more timeout.")
RISEN_AGAIN = threshold("risen_again", 0.03, "m",
    "Height by which a gripper that closed in part, or ran into something, rises again if it has given up that try.",
    "Larger: fewer tries are over; fewer execution_failure, more timeout.",
    listed=False)

# To and fro.
TO_AND_FRO = threshold("to_and_fro", 5.0, "1",
    "Length of the way of an empty gripper, in diameters of the region it stays in, from which it goes to and fro; "
    "a straight way has 1, and of the ways of honest policies between two grasps 99 % have less than 4.4.",
    "Larger: fewer ways go to and fro; fewer phase_conflict, more timeout.")
TO_AND_FRO_TRAVEL = threshold("to_and_fro_travel", 0.4, "m",
    "Least length of a way to and fro; servo jitter adds up to less in a minute.",
    "Larger: fewer ways go to and fro; fewer phase_conflict, more timeout.")
LEAST_REGION = threshold("least_region", 0.02, "m",
    "Diameter that a region of a way to and fro has at least, so that an arm which trembles in place does not go to "
    "and fro.",
    "Larger: fewer small ways go to and fro; fewer phase_conflict, more timeout and early_halt.",
    listed=False)
COMES_NEARER = threshold("comes_nearer", 0.15, "1",
    "Share of its distance to the right thing by which the middle of a way to and fro comes nearer from each "
    "quarter to the next if it leads there, slowly; who goes to and fro and settles on nothing comes no nearer.",
    "Larger: fewer ways lead to what is asked for; more phase_conflict, fewer timeout.")

# Halts.
HALT_RADIUS = threshold("halt_radius", 0.03, "m",
    "Distance from where it stopped within which an arm that halts stays to the end; noise on the actions moves it "
    "by less than 1 cm.",
    "Larger: more arms stay in place to the end; more early_halt and phase_conflict, fewer timeout.")
DRIFT = threshold("drift", 0.002, "m/s",
    "Speed with which an arm that halts may drift off beside that: nobody who watches sees it move, and in the "
    "whole time of a trial it comes nowhere. A policy whose commands are noise around zero drifts as far.",
    "Larger: more arms that creep have halted; more early_halt and phase_conflict, fewer timeout.")
COME_TO_REST = threshold("come_to_rest", 0.005, "m",
    "Distance from where it is within which an arm that was slow before has to stay to the end, drift apart, to "
    "have come to rest there; one that creeps on at 4 mm/s or more has not.",
    "Larger: more slow stretches end at rest; more early_halt and phase_conflict, fewer timeout.")
PAUSES_VARY = threshold("pauses_vary", 1.5, "1",
    "Length of a stand in longest pauses before it, of a policy that makes long ones, from which it is no pause "
    "more.",
    "Larger: more stands at the end are pauses; fewer early_halt, more timeout.")
TREMBLE_TIME = threshold("tremble_time", 8.0, "s",
    "Time from which an arm that stays within halt_radius to the end has halted even if it never stands still; "
    "honest policies of the independent family go on after at most 6.5 s.",
    "Larger: an arm has to tremble in place for longer; fewer early_halt and phase_conflict, more timeout.")
OVER_GOAL = threshold("over_goal", 0.06, "m",
    "Horizontal distance from the middle of its place within which a held object has been brought there; wider "
    "places count up to their edge.",
    "Larger: more objects are held at their place; more timeout of a gripper that never opens, fewer early_halt.")
SEARCH_STEP = threshold("search_step", 0.5, "s",
    "Time between the rows from which a halt, or a way to and fro, is looked for; shorter steps find the same ones "
    "a little earlier.",
    "Larger: halts and ways to and fro begin later or are missed; fewer early_halt and phase_conflict, more "
    "timeout.",
    listed=False)

# Other worlds.
RESTS_ON_GAP = threshold("rests_on_gap", 0.01, "m",
    "Height of an object over where it would rest on a target in LIBERO up to which it is on it: tops are uneven, and "
    "contacts are not asked for.",
    "Larger: more objects are on their targets; more causal_confusion of finished steps, fewer execution_failure.",
    listed=False)

# The second pass: which rule explains the first attempts of a policy (docs/second-pass.md).
HIGHEST_STRENGTH = threshold("highest_strength", 0.99, "1",
    "Largest strength of a rule that is tried; no number of trials of a run can tell a larger one apart.",
    "Larger: rules without an exception cost less and those with one are unchanged; more lexical_kinematic_shortcut "
    "and visual_layout_bias, fewer wrong_object.",
    listed=False)
LOWEST_ERROR_RATE = threshold("lowest_error_rate", 0.001, "1",
    "Smallest error rate of confusion that is tried; above zero, so that one error is not impossible.",
    "Larger: confusion costs more for a policy that seldom errs; more lexical_kinematic_shortcut and "
    "visual_layout_bias, fewer wrong_object.",
    listed=False)
HIGHEST_ERROR_RATE = threshold("highest_error_rate", 0.99, "1",
    "Largest error rate of confusion that is tried, also where guessing errs more often; below 1, so that one right "
    "attempt is not impossible.",
    "Larger: confusion costs less for a policy that errs nearly always; more wrong_object, fewer "
    "lexical_kinematic_shortcut and visual_layout_bias.",
    listed=False)
ORDER_TRIALS = threshold("order_trials", 3, "1",
    "Wrong first attempts at later steps from which a policy is taken for one that mistakes the order, if that "
    "explains its attempts as well as anything else does. One or two may as well be at a favorite place.",
    "Larger: fewer policies mistake the order; fewer order_violation and causal_confusion, more visual_layout_bias "
    "and lexical_kinematic_shortcut.",
    listed=False)
OTHER_TASKS = threshold("other_tasks", 2, "1",
    "Other tasks in which a rule has to be proven before it counts in a task whose own trials could not prove it; "
    "one may be chance.",
    "Larger: less is known of a policy from its other tasks; fewer visual_layout_bias and order_violation, more "
    "wrong_object.",
    listed=False)
ONE_ATTEMPT = threshold("one_attempt", 3.0, "1",
    "What one first attempt is worth that a rule predicts and another does not [nats]: it has a probability of nearly "
    "1 by the first rule and of slip by the other, and -log(slip) is 3.0.",
    "Larger: the rule of all tasks decides more attempts that fit several rules; more of the label of that rule, "
    "fewer wrong_object.",
    listed=False)
CLEARLY = threshold("clearly_better", 2.0, "1",
    "Nats by which one kind of rule has to explain all tasks better than any other to be that of the policy: odds "
    "of 7.",
    "Larger: fewer policies have one rule in all tasks; more wrong_object, fewer lexical_kinematic_shortcut and "
    "visual_layout_bias.",
    listed=False)

# The instruction effect, and what decides in place of the instruction.
LEAST_PAIRS = threshold("instruction_pairs", 10, "1",
    "Pairs from which a policy can be said not to use the instruction; with fewer, chance alone could not be told "
    "from it.",
    "Larger: fewer policies are said not to use the instruction; fewer visual_layout_bias, more wrong_object.",
    listed=False)
USED = threshold("instruction_used", 0.5, "1",
    "Instruction effect of a policy that picks one of two things at random: what has to be excluded before a policy "
    "is said not to use the instruction.",
    "Larger: more policies are said not to use the instruction, and fewer to go for one thing wherever it stands; "
    "more visual_layout_bias in our own scenes, fewer in other worlds.",
    listed=False)
LEVEL = threshold("instruction_level", 0.025, "1",
    "Level of the one-sided tests that the instruction is not used: that of one side of a 95 % interval.",
    "Larger: more policies are said not to use the instruction; more visual_layout_bias, fewer wrong_object.",
    listed=False)
LEAST_ASKED = threshold("favorite_asked", 3, "1",
    "Kinds of things that were asked for in vain, from which on no word that is mistaken for another explains it.",
    "Larger: fewer policies have a favorite thing; fewer visual_layout_bias, more wrong_object.",
    listed=False)
NEARLY_ALL = threshold("nearly_all", 0.9, "1",
    "Share of the first attempts that a place, a thing, a color or nearness has to explain before it is named in "
    "place of the instruction; a tenth may be slips.",
    "Larger: less is named; a visual_layout_bias keeps its label, and its evidence names a place less often.",
    listed=False)

# Sentences about several trials, and the power matrix.
SHARE_OF_ALL = threshold("share_of_all", 0.8, "1",
    "Share of a policy's trials of one mode that have to look alike for its conclusion to say more than the mode "
    "does.",
    "Larger: no label changes; conclusions say less.",
    listed=False)
REPLAY_LIMIT = threshold("replay_limit", 0.25, "1",
    "Success rate up to which motion without looking is no way to solve a variation: what the jitter of slots "
    "leaves.",
    "Larger: no label changes; more variations count as evidence of an ability.")
FAILS_AT = threshold("fails_at", 0.5, "1",
    "Success rate up to which a pretender is said to fail a variation: no better than a coin.",
    "Larger: no label changes; more variations count as evidence of an ability.")
# fmt: on
