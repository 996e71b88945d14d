"""Thresholds used only by the diagnosis, each with its unit, its reason and the effect of increasing it.

Thresholds shared with live judging (goal tracker, grasp attempts, harm) are in :mod:`betterbench.tasks.thresholds`,
together with the thresholds for halts, falls, collisions and slips that every run lists in its conventions. A
relation's tolerance is in the relation file.

Entries that are not listed were added to this table after they were in use: see
:func:`betterbench.tasks.thresholds.threshold`.
"""

from betterbench.tasks.thresholds import THRESHOLDS, threshold

# fmt: off
# Between a grasp and its target.
DOUBT = threshold("doubt", 0.03, "m",
    "Maximum distance by which the instructed object may be farther away than another object to count as the missed "
    "object of an empty grasp. Poor aim does not prove a wrong choice.",
    "Larger: more misses are attributed to the requested object; more execution_failure, fewer wrong_object and "
    "behavioral_inertia.")
BETWEEN = threshold("between", 0.02, "m",
    "Maximum distance by which another object may be farther away than the requested object for the target of an "
    "empty grasp to be ambiguous. It is about the position noise of a closing gripper.",
    "Larger: more misses are ambiguous; more execution_failure without a first attempt that counts, fewer "
    "wrong_object.")
UNDONE_WITHIN = threshold("undone_within", 3.0, "s",
    "Time before an attempt within which it is ignored that a finished step is no longer done. The target was chosen "
    "before, and the approaching gripper often knocked the object away itself.",
    "Larger: more attempts at a later step are right; fewer order_violation and causal_confusion, more "
    "execution_failure.")
SQUEEZES = threshold("squeezes", 3, "1",
    "Number of times that the fingers must partly close around an instructed object and open again to count as an "
    "attempt. Once or twice may be command noise.",
    "Larger: fewer partial grasps are attempts; fewer execution_failure with a weak grip, more timeout.")
TRIES_IN_VAIN = threshold("tries_in_vain", 3, "1",
    "Number of failed or prematurely released grasps of the correct object that make the trial an execution failure, "
    "even if the gripper holds the object at the step limit. Policies without a fault had at most two.",
    "Larger: more failed grasps are tolerated if the last one holds the object; fewer execution_failure, more "
    "timeout.")
MEMORIZED_SPOT = threshold("memorized_spot", 0.04, "m",
    "Maximum distance from an object to the position that would be correct if the target were still in its training "
    "slot. Slots and placements each vary by 15 mm to each side.",
    "Larger: more placements count as memorized; more behavioral_inertia, fewer execution_failure.")

# Stays: an empty gripper over an object.
OVER_HEIGHT = threshold("over_height", 0.12, "m",
    "Maximum height above the top of an object at which an open gripper is over the object. Grasps from above begin "
    "at this height.",
    "Larger: the gripper is over objects from higher up; more wrong_object and semantic_feature_collapse by a stay, "
    "fewer phase_conflict and timeout.")
BESIDE = threshold("over_beside", 0.01, "m",
    "Maximum horizontal distance from an object at which an open gripper is still over it.",
    "Larger: the gripper is over objects from farther away; more wrong_object and semantic_feature_collapse by a "
    "stay, fewer phase_conflict and timeout.")
STAY_TIME = threshold("stay_time", 2.0, "s",
    "Total time for which an open gripper must stay over an object to choose it. Policies without a fault "
    "stay over another object for up to 4 s before they grasp, and the grasp then decides.",
    "Larger: fewer stays choose an object; fewer wrong_object and semantic_feature_collapse, more timeout.")
STAY_SHARE = threshold("stay_share", 0.7, "1",
    "Minimum share of the time over any object that is spent over the chosen object. With a smaller share, the "
    "gripper moves back and forth.",
    "Larger: a stay chooses an object only if the gripper is over it nearly all the time; fewer wrong_object, more "
    "phase_conflict and timeout.")
PASSING = threshold("passing", 0.08, "m",
    "Minimum distance between the points where the gripper comes over an object and leaves it again, for the gripper "
    "to be only passing.",
    "Larger: fewer paths over an object are passing; more wrong_object and semantic_feature_collapse by a stay, fewer "
    "timeout.")
PASSING_AT_END = threshold("passing_at_end", 0.25, "1",
    "Minimum share of the passing distance that a gripper must have covered to be passing if it is still over the "
    "object when the episode ends.",
    "Larger: more stays at the end count; more wrong_object by a stay, fewer timeout.",
    listed=False)
STRAIGHT = threshold("straight", 0.8, "1",
    "Minimum ratio of the start-to-end distance to the path length for a straight path; motion back and forth "
    "has a smaller ratio.",
    "Larger: fewer paths at the end are passing; more wrong_object by a stay, fewer timeout.",
    listed=False)
RETREAT = threshold("retreat", 0.15, "m",
    "Distance that an open gripper must move away from its position over an object before coming back is a return.",
    "Larger: fewer returns count; fewer phase_conflict, more timeout.")
RETURNS = threshold("returns", 3, "1",
    "Number of times that an open gripper must come over the correct object, leaving it in between, for the motion to "
    "count as moving back and forth. None of 645 trials of the independent family without a fault "
    "had even two before the first grasp.",
    "Larger: more returns are tolerated; fewer phase_conflict, more timeout.")
COMES_DOWN = threshold("comes_down", 0.035, "m",
    "Maximum height above a flat object's base at which a gripper has come down to the object. Plates, slices and "
    "cutlery are lower than the fingers, so the tool center point is above their top during a grasp.",
    "Larger: the gripper has come down to flat objects earlier; more timeout for grippers that do not close, fewer "
    "phase_conflict.")
FLICKER_TIME = threshold("flicker_time", 0.25, "s",
    "Interruptions of a contact, a stay or a grip that are shorter than this are ignored, because contacts and "
    "positions tremble.",
    "Larger: more interruptions are ignored; fewer phase_conflict and execution_failure that need several separate "
    "events, more wrong_object by a stay.",
    listed=False)

# Pushes, and failed grasps of the correct object.
PUSH_TRAVEL = threshold("push_travel", 0.08, "m",
    "Minimum distance over which an empty gripper must move an object for a push. In 297 trials, policies without a "
    "fault moved an ungrasped object by at most 1 cm.",
    "Larger: fewer touches are pushes; fewer wrong_object and execution_failure by a push, more timeout.")
PUSH_SHARE = threshold("push_share", 0.5, "1",
    "Minimum share of push_travel that the gripper itself must move for a push, and that an object must move to be "
    "shoved aside. An object that rolls off moves farther than the gripper.",
    "Larger: fewer touches are pushes or shoves; fewer wrong_object and execution_failure by a push, more "
    "phase_conflict and timeout.",
    listed=False)
PUSH_GAP = threshold("push_gap", 1.0, "s",
    "Maximum time between two touches of the same push. An object that slides ahead of a gripper is touched "
    "intermittently and keeps sliding for a moment.",
    "Larger: more touches belong to one push; fewer objects are moved several times, so fewer wrong_object and "
    "execution_failure by a push.")
PUSH_ALONG = threshold("push_along", 0.8, "1",
    "Minimum cosine of the angle between the displacements of gripper and object for a push.",
    "Larger: the displacements must be more nearly parallel; fewer wrong_object and execution_failure by a push.")
PUSH_AGAIN = threshold("push_again", 3, "1",
    "Number of times that an empty gripper must come to an object and move it for the object to count as attempted. "
    "The object may also roll off, fall over, or move in another direction than the gripper.",
    "Larger: fewer objects count as pushed by repeated contact; fewer wrong_object and execution_failure, more "
    "timeout.")
SHOVED_AGAIN = threshold("shoved_again", 2, "1",
    "Number of times that an empty gripper must move the correct object aside, without ever grasping it, for the grasp "
    "to have failed. For a wrong object more contacts or a push are required, because an arm may run into it on its "
    "way.",
    "Larger: more shoves are tolerated; fewer execution_failure, more timeout.")
BEGINS_TO_MOVE = threshold("begins_to_move", 0.002, "m",
    "Displacement above which a touched object is moving; contact noise is smaller.",
    "Larger: pushes begin later, so that other evidence more often comes first; fewer wrong_object by a push.",
    listed=False)
CLOSED_IN_PART = threshold("closed_in_part", THRESHOLDS.finger_travel, "m",
    "Minimum finger travel for an intended grasp if the fingers close around an object without contact. Fingers are "
    "preset to the object width before they descend.",
    "Larger: fewer partial grasps are intended; fewer execution_failure, more timeout.")
RUNS_INTO = threshold("runs_into", 3, "1",
    "Number of times that an open gripper must descend, run into the correct object and rise again for the grasp to "
    "have failed. A policy that is merely slow does not run into the object.",
    "Larger: more contacts with the correct object are tolerated; fewer execution_failure, more timeout.")
RISEN_AGAIN = threshold("risen_again", 0.03, "m",
    "Height by which a gripper must rise after a partial grasp, or after a contact from above, to have given up the "
    "attempt.",
    "Larger: fewer attempts are given up; fewer execution_failure, more timeout.",
    listed=False)

# Back and forth.
TO_AND_FRO = threshold("to_and_fro", 5.0, "1",
    "Minimum ratio between an empty gripper's path length and the diameter of its region for motion back and forth. A "
    "straight path has 1; 99 % of the paths of policies without a fault between two grasps have less than 4.4.",
    "Larger: fewer paths are back and forth; fewer phase_conflict, more timeout.")
TO_AND_FRO_TRAVEL = threshold("to_and_fro_travel", 0.4, "m",
    "Minimum path length of motion back and forth. Servo jitter adds up to less in a minute.",
    "Larger: fewer paths are back and forth; fewer phase_conflict, more timeout.")
LEAST_REGION = threshold("least_region", 0.02, "m",
    "Minimum diameter of the region of motion back and forth, so that an arm trembling in place is excluded.",
    "Larger: fewer small motions are back and forth; fewer phase_conflict, more timeout and early_halt.",
    listed=False)
COMES_NEARER = threshold("comes_nearer", 0.15, "1",
    "Minimum approach of a path to the correct object from each quarter of the path to the next, as a fraction of "
    "the distance of the path's center. A path that approaches less does not lead to the object but moves back and "
    "forth.",
    "Larger: fewer paths lead to a requested object; more phase_conflict, fewer timeout.")

# Halts.
HALT_RADIUS = threshold("halt_radius", 0.03, "m",
    "Maximum distance from its stopping point that a halted arm may reach until the end. Action noise moves it by "
    "less than 1 cm.",
    "Larger: more arms stay in place to the end; more early_halt and phase_conflict, fewer timeout.")
DRIFT = threshold("drift", 0.002, "m/s",
    "Maximum speed at which a halted arm may drift in addition. This drift is invisible to an observer and leads "
    "nowhere within a trial. A policy whose actions are noise around zero drifts as fast.",
    "Larger: more creeping arms count as halted; more early_halt and phase_conflict, fewer timeout.")
COME_TO_REST = threshold("come_to_rest", 0.005, "m",
    "Maximum distance, apart from drift, that an arm may move until the end after a slow stretch, to have come to "
    "rest there. An arm that creeps at 4 mm/s or more has not come to rest.",
    "Larger: more slow stretches end at rest; more early_halt and phase_conflict, fewer timeout.")
PAUSES_VARY = threshold("pauses_vary", 1.5, "1",
    "For a policy with long pauses: multiple of its longest earlier pause above which a stop is a halt.",
    "Larger: more stops at the end are pauses; fewer early_halt, more timeout.")
TREMBLE_TIME = threshold("tremble_time", 8.0, "s",
    "Time within halt_radius until the end after which an arm that is never completely still has halted. Policies "
    "without a fault move on after at most 6.5 s.",
    "Larger: an arm must tremble in place for longer; fewer early_halt and phase_conflict, more timeout.")
OVER_GOAL = threshold("over_goal", 0.06, "m",
    "Maximum horizontal distance between a held object and the center of its target region for the object to count "
    "as brought there. Wider regions count up to their edge.",
    "Larger: more objects are held at their target region; more timeout for grippers that never open, fewer "
    "early_halt.")
SEARCH_STEP = threshold("search_step", 0.5, "s",
    "Interval at which starts of a halt, or of motion back and forth, are searched. A shorter interval finds the "
    "same starts slightly earlier.",
    "Larger: halts and motion back and forth begin later or are missed; fewer early_halt and phase_conflict, more "
    "timeout.",
    listed=False)

# Other worlds.
RESTS_ON_GAP = threshold("rests_on_gap", 0.01, "m",
    "Maximum gap between an object and a target's support surface in LIBERO for the object to be on the surface: "
    "surfaces are uneven, and contacts are not required.",
    "Larger: more objects are on their targets; more causal_confusion of finished steps, fewer execution_failure.",
    listed=False)

# The second pass: the rule that explains the first attempts of a policy (docs/second-pass.md).
HIGHEST_STRENGTH = threshold("highest_strength", 0.99, "1",
    "Largest tried strength of a rule; no run has enough trials to distinguish a larger one.",
    "Larger: rules without exceptions cost less, others are unchanged; more lexical_kinematic_shortcut and "
    "visual_layout_bias, fewer wrong_object.",
    listed=False)
LOWEST_ERROR_RATE = threshold("lowest_error_rate", 0.001, "1",
    "Smallest tried error rate of confusion. It is above zero, so that a single error is not impossible.",
    "Larger: confusion costs more for a policy that seldom errs; more lexical_kinematic_shortcut and "
    "visual_layout_bias, fewer wrong_object.",
    listed=False)
HIGHEST_ERROR_RATE = threshold("highest_error_rate", 0.99, "1",
    "Largest tried error rate of confusion, even if guessing errs more often. It is below 1, so that a single "
    "correct attempt is not impossible.",
    "Larger: confusion costs less for a policy that nearly always errs; more wrong_object, fewer "
    "lexical_kinematic_shortcut and visual_layout_bias.",
    listed=False)
ORDER_TRIALS = threshold("order_trials", 3, "1",
    "Minimum number of wrong first attempts at later steps for a policy to be classified as mistaking the order, if "
    "that explains its attempts at least as well as any other rule. One or two may be at a favorite slot instead.",
    "Larger: fewer policies mistake the order; fewer order_violation and causal_confusion, more visual_layout_bias "
    "and lexical_kinematic_shortcut.",
    listed=False)
OTHER_TASKS = threshold("other_tasks", 2, "1",
    "Number of other tasks that must prove a rule before it counts in a task whose own trials cannot prove it. A "
    "proof in a single task may be chance.",
    "Larger: fewer rules carry over from other tasks; fewer visual_layout_bias and order_violation, more "
    "wrong_object.",
    listed=False)
ONE_ATTEMPT = threshold("one_attempt", 3.0, "1",
    "Weight of one first attempt that only one of two rules predicts [nats]. Its probability is nearly 1 under that "
    "rule and slip under the other, and -log(slip) is 3.0.",
    "Larger: the rule over all tasks decides more attempts that fit several rules; more of that rule's label, fewer "
    "wrong_object.",
    listed=False)
CLEARLY = threshold("clearly_better", 2.0, "1",
    "Margin in nats by which one kind of rule must explain all tasks better than any other kind to be the policy's "
    "rule. By the same margin, confusion must explain a task better than a habit to reject the habit. It corresponds "
    "to odds of 7.",
    "Larger: fewer policies have one rule in all tasks; more wrong_object, fewer lexical_kinematic_shortcut and "
    "visual_layout_bias.",
    listed=False)

# The instruction effect, and the cues that determine the attempts instead of the instruction.
LEAST_PAIRS = threshold("instruction_pairs", 10, "1",
    "Minimum number of pairs for the conclusion that a policy does not use the instruction. With fewer, chance "
    "cannot be excluded.",
    "Larger: fewer policies are found not to use the instruction; fewer visual_layout_bias, more wrong_object.",
    listed=False)
USED = threshold("instruction_used", 0.5, "1",
    "Instruction effect of a policy that picks one of two objects at random. This value must be excluded before "
    "concluding that a policy does not use the instruction.",
    "Larger: more policies are found not to use the instruction, and fewer to have a favorite kind of object; more "
    "visual_layout_bias in betterbench's own scenes, fewer in other worlds.",
    listed=False)
LEVEL = threshold("instruction_level", 0.025, "1",
    "Level of the one-sided tests that the instruction is not used, as for one side of a 95 % interval.",
    "Larger: more policies are found not to use the instruction; more visual_layout_bias, fewer wrong_object.",
    listed=False)
LEAST_ASKED = threshold("favorite_asked", 3, "1",
    "Minimum number of other kinds that were requested without success. With this many, confused words no longer "
    "explain the favorite kind.",
    "Larger: fewer policies have a favorite kind of object; fewer visual_layout_bias, more wrong_object.",
    listed=False)
NEARLY_ALL = threshold("nearly_all", 0.9, "1",
    "Minimum share of the first attempts that a slot, kind, color or distance must explain to be named as the "
    "deciding cue. The same share applies to a confused word. A tenth of the attempts may be slips.",
    "Larger: fewer cues and confused words are named; a visual_layout_bias keeps its label, and its evidence names a "
    "place less often.",
    listed=False)

# Thresholds for conclusions from several trials, and for the power matrix.
SHARE_OF_ALL = threshold("share_of_all", 0.8, "1",
    "Minimum share of a policy's trials with one failure mode that must share a form for a conclusion to name the "
    "form.",
    "Larger: no label changes; conclusions are less specific.",
    listed=False)
REPLAY_LIMIT = threshold("replay_limit", 0.25, "1",
    "Maximum success rate of replayed motion on a variation that such motion does not solve. With the jitter of the "
    "slots, replays still succeed this often by chance.",
    "Larger: no label changes; more variations count as evidence of an ability.")
FAILS_AT = threshold("fails_at", 0.5, "1",
    "Maximum success rate at which a pretender fails a variation: the rate of a coin flip.",
    "Larger: no label changes; more variations count as evidence of an ability.")

# Evidence from the joint states of a real arm (betterbench.real). The simulated diagnosis does not use these values, so
# its stored results do not list them. The gripper opening is in percent of its travel, 0 closed and 100 open.
JAW_MOVES = threshold("jaw_moves", 5.0, "%",
    "Minimum change of the opening for the jaw to have closed or opened. The encoder resolves 0.08 % and a printed "
    "jaw has a backlash of about 1 %; 5 % are 5 mm at the fingertip of an SO-101.",
    "Larger: fewer grasps are found in joint states; fewer behavioral_inertia and execution_failure of a real arm, "
    "more early_halt.",
    listed=False)
JAW_RESTS = threshold("jaw_rests", 1.5, "%",
    "Largest change of the opening within stop_time of a jaw that has stopped. Backlash and encoder noise are smaller.",
    "Larger: a slowly closing jaw counts as stopped; fewer behavioral_inertia of a real arm, more execution_failure.",
    listed=False)
JAW_GAP = threshold("jaw_gap", 4.0, "%",
    "Minimum distance between measured and commanded opening at which a stopped jaw is held open by an object. The "
    "empty jaw of the twin follows its command within 0.1 %, and around a fruit it stops 8 to 9 % short of it.",
    "Larger: fewer grasps have an object if the load is unknown; fewer success and more contradictions with human "
    "observations, so no label changes by itself.",
    listed=False)
JAW_LOAD = threshold("jaw_load", 0.1, "1",
    "Minimum load of the gripper's motor, as a fraction of its maximum, of a jaw that presses on an object. This is a "
    "choice: the friction of the motor is 0.052 of 2.94 N m, and LeRobot limits the gripper to half of its torque. It "
    "has not been measured on the arm.",
    "Larger: fewer grasps have an object if the load is known; more behavioral_inertia of a real arm.",
    listed=False)
JAW_SHUT = threshold("jaw_shut", 15.0, "%",
    "Opening up to which no object of the fruit basket fits between the jaws. It corresponds to 26 mm; the narrowest "
    "object is 35 mm wide, which is 22 %.",
    "Larger: more grasps are empty; more behavioral_inertia and phase_conflict of a real arm.",
    listed=False)
JAW_FULLY_SHUT = threshold("jaw_fully_shut", 4.0, "%",
    "Opening up to which the jaws touch each other. A load is then not evidence of an object. The calibration of the "
    "closed jaw varies by up to 2 %.",
    "Larger: more grasps with a load are empty; more behavioral_inertia of a real arm.",
    listed=False)
HELD_SHARE = threshold("held_share", 0.5, "1",
    "Share of control steps without an answer of the policy from which the trial is a failure of the system.",
    "Larger: fewer policy_error of a real arm, more early_halt and phase_conflict.",
    listed=False)
# fmt: on
