"""Thresholds that only the diagnosis uses, each with its unit, its reason and the effect of increasing it.

Thresholds that the diagnosis shares with live judging (goal tracker, grasp attempts, harm) are in
:mod:`betterbench.tasks.thresholds`. The thresholds for halts, falls, collisions and slips, which every run lists in its
conventions, are also there. The tolerance of a relation is in the file of the relation.

Thresholds with ``listed=False`` were already in use when they were added to this table (see
:func:`betterbench.tasks.thresholds.threshold`).
"""

from betterbench.tasks.thresholds import THRESHOLDS, threshold

# fmt: off
# Between a grasp and its target.
DOUBT = threshold("doubt", 0.03, "m",
    "A gripper that closes without an object counts as having missed the requested object if that object is at most "
    "this much farther away than another object. Poor aim alone does not prove a wrong choice.",
    "Larger: more misses are attributed to the requested object; more execution_failure, fewer wrong_object and "
    "behavioral_inertia.")
BETWEEN = threshold("between", 0.02, "m",
    "The target of a gripper that closes without an object is ambiguous if another object is at most this much farther "
    "away than the requested object. The value is about the position noise of a closing gripper.",
    "Larger: more misses are ambiguous; more execution_failure without a first attempt that counts, fewer "
    "wrong_object.")
UNDONE_WITHIN = threshold("undone_within", 3.0, "s",
    "If a finished step is undone within this time before an attempt, the attempt is judged as if the step were still "
    "done. The gripper was already on its way then, and often it knocked the object away itself.",
    "Larger: more attempts at a later step are correct; fewer order_violation and causal_confusion, more "
    "execution_failure.")
SQUEEZES = threshold("squeezes", 3, "1",
    "Number of times that the fingers must partly close around a requested object and open again before this counts "
    "as an attempt. One or two times may be noise in the commands.",
    "Larger: fewer partial grasps are attempts; fewer execution_failure with a weak grip, more timeout.")
TRIES_IN_VAIN = threshold("tries_in_vain", 3, "1",
    "Number of grasps of the correct object that failed, or were released too early, after which the trial is an "
    "execution failure even if the gripper holds the object at the step limit. Policies without a fault had at most "
    "two such grasps.",
    "Larger: more failed grasps are tolerated if the last one holds the object; fewer execution_failure, more "
    "timeout.")
MEMORIZED_SPOT = threshold("memorized_spot", 0.04, "m",
    "An object counts as placed at a memorized position if it is at most this far from the position that would be "
    "correct if the target were still in its training slot. The positions of slots and of placements each vary by "
    "15 mm to each side.",
    "Larger: more placements count as memorized; more behavioral_inertia, fewer execution_failure.")

# Stays: an empty gripper over an object.
OVER_HEIGHT = threshold("over_height", 0.12, "m",
    "Largest height above the top of an object at which an open gripper is over the object. Grasps from above begin "
    "at this height.",
    "Larger: the gripper is over objects from higher up; more wrong_object and semantic_feature_collapse by a stay, "
    "fewer phase_conflict and timeout.")
BESIDE = threshold("over_beside", 0.01, "m",
    "Maximum horizontal distance from an object at which an open gripper is still over it.",
    "Larger: the gripper is over objects from farther away; more wrong_object and semantic_feature_collapse by a "
    "stay, fewer phase_conflict and timeout.")
STAY_TIME = threshold("stay_time", 2.0, "s",
    "Total time for which an open gripper must stay over an object before the policy counts as having chosen it. "
    "Policies without a fault stay over other objects for up to 4 s before they grasp, but then the grasp decides.",
    "Larger: fewer stays choose an object; fewer wrong_object and semantic_feature_collapse, more timeout.")
STAY_SHARE = threshold("stay_share", 0.7, "1",
    "Of the time that the gripper spends over objects, it must spend at least this fraction over the chosen object. "
    "With a smaller fraction, it moves back and forth between objects.",
    "Larger: a stay chooses an object only if the gripper is over it nearly all the time; fewer wrong_object, more "
    "phase_conflict and timeout.")
PASSING = threshold("passing", 0.08, "m",
    "A gripper only passes over an object if the point at which it comes over the object and the point at which it "
    "leaves are at least this far apart.",
    "Larger: fewer paths over an object are passing; more wrong_object and semantic_feature_collapse by a stay, fewer "
    "timeout.")
PASSING_AT_END = threshold("passing_at_end", 0.25, "1",
    "If the gripper is still over the object when the episode ends, it is only passing if it has covered at least "
    "this fraction of the passing distance.",
    "Larger: more stays at the end count; more wrong_object by a stay, fewer timeout.",
    listed=False)
STRAIGHT = threshold("straight", 0.8, "1",
    "A path is straight if the distance between its ends is at least this fraction of its length. Motion back and "
    "forth has a smaller fraction.",
    "Larger: fewer paths at the end are passing; more wrong_object by a stay, fewer timeout.",
    listed=False)
RETREAT = threshold("retreat", 0.15, "m",
    "Distance that an open gripper must move away from an object so that its coming back counts as a return.",
    "Larger: fewer returns count; fewer phase_conflict, more timeout.")
RETURNS = threshold("returns", 3, "1",
    "Number of times that an open gripper must come over the correct object, and leave it in between, to count as "
    "moving back and forth. Among 645 trials of the independent family without a fault, none had more than one before "
    "the first grasp.",
    "Larger: more returns are tolerated; fewer phase_conflict, more timeout.")
COMES_DOWN = threshold("comes_down", 0.035, "m",
    "Largest height above a flat object's base at which a gripper has come down to the object. Plates, slices and "
    "cutlery are lower than the fingers, so the tool center point is above their top during a grasp.",
    "Larger: the gripper has come down to flat objects earlier; more timeout for grippers that do not close, fewer "
    "phase_conflict.")
FLICKER_TIME = threshold("flicker_time", 0.25, "s",
    "Interruptions of a contact, a stay or a grip that are shorter than this are ignored, because contacts and "
    "positions are noisy.",
    "Larger: more interruptions are ignored; fewer phase_conflict and execution_failure that need several separate "
    "events, more wrong_object by a stay.",
    listed=False)

# Pushes, and failed grasps of the correct object.
PUSH_TRAVEL = threshold("push_travel", 0.08, "m",
    "An empty gripper has pushed an object if it moved the object by at least this distance. In 297 trials, policies "
    "without a fault moved no object by more than 1 cm without grasping it.",
    "Larger: fewer touches are pushes; fewer wrong_object and execution_failure by a push, more timeout.")
PUSH_SHARE = threshold("push_share", 0.5, "1",
    "In a push, the gripper itself moves by at least this fraction of push_travel, because an object that rolls off "
    "moves farther than the gripper. An object that is moved by this fraction is shoved aside.",
    "Larger: fewer touches are pushes or shoves; fewer wrong_object and execution_failure by a push, more "
    "phase_conflict and timeout.",
    listed=False)
PUSH_GAP = threshold("push_gap", 1.0, "s",
    "Two touches belong to the same push if the time between them is at most this long. An object that slides ahead of "
    "a gripper is touched intermittently and keeps sliding for a moment.",
    "Larger: more touches belong to one push; fewer objects are moved several times, so fewer wrong_object and "
    "execution_failure by a push.")
PUSH_ALONG = threshold("push_along", 0.8, "1",
    "In a push, the cosine of the angle between the gripper's displacement and the object's is at least this large.",
    "Larger: the displacements must be more nearly parallel; fewer wrong_object and execution_failure by a push.")
PUSH_AGAIN = threshold("push_again", 3, "1",
    "An object counts as attempted if an empty gripper comes to it and moves it this many times, even if the object "
    "rolls off or falls over and moves in another direction than the gripper.",
    "Larger: fewer objects count as pushed by repeated contact; fewer wrong_object and execution_failure, more "
    "timeout.")
SHOVED_AGAIN = threshold("shoved_again", 2, "1",
    "If an empty gripper moves the correct object aside this many times and never grasps it, the grasp has failed. "
    "For a wrong object, more contacts or a push are required, because an arm may run into it on its way.",
    "Larger: more shoves are tolerated; fewer execution_failure, more timeout.")
BEGINS_TO_MOVE = threshold("begins_to_move", 0.002, "m",
    "A touched object has begun to move when its displacement exceeds this distance. Contact noise is smaller.",
    "Larger: pushes begin later, so that other evidence more often comes first; fewer wrong_object by a push.",
    listed=False)
CLOSED_IN_PART = threshold("closed_in_part", THRESHOLDS.finger_travel, "m",
    "If the fingers close around an object without touching it, a grasp was intended if they moved by at least this "
    "distance. Fingers that are only set to the width of the object move before they descend.",
    "Larger: fewer partial grasps are intended; fewer execution_failure, more timeout.")
RUNS_INTO = threshold("runs_into", 3, "1",
    "If an open gripper descends, runs into the correct object and rises again this many times, the grasp has failed. "
    "A policy that is merely slow does not run into the object.",
    "Larger: more contacts with the correct object are tolerated; fewer execution_failure, more timeout.")
RISEN_AGAIN = threshold("risen_again", 0.03, "m",
    "The gripper has given up an attempt if it rises by at least this height after a partial grasp, or after it "
    "touched the object from above.",
    "Larger: fewer attempts are given up; fewer execution_failure, more timeout.",
    listed=False)

# Back and forth.
TO_AND_FRO = threshold("to_and_fro", 5.0, "1",
    "An empty gripper moves back and forth if its path is at least this many times as long as the diameter of the "
    "region that it covers. The ratio of a straight path is 1. Between two grasps, 99 % of the paths of policies "
    "without a fault have a ratio below 4.4.",
    "Larger: fewer paths are back and forth; fewer phase_conflict, more timeout.")
TO_AND_FRO_TRAVEL = threshold("to_and_fro_travel", 0.4, "m",
    "Motion back and forth must cover a path of at least this length. The path of servo jitter in a minute is shorter.",
    "Larger: fewer paths are back and forth; fewer phase_conflict, more timeout.")
LEAST_REGION = threshold("least_region", 0.02, "m",
    "Smallest diameter of the region in which motion back and forth is recognized. An arm that trembles in place "
    "covers a smaller region.",
    "Larger: fewer small motions are back and forth; fewer phase_conflict, more timeout and early_halt.",
    listed=False)
COMES_NEARER = threshold("comes_nearer", 0.15, "1",
    "Minimum approach for a path that leads to the correct object. The path is divided into quarters. From each "
    "quarter to the next, the center of the quarter must come nearer to the object by at least this fraction of the "
    "distance. In undecided motion back and forth, the center does not come nearer.",
    "Larger: fewer paths lead to a requested object; more phase_conflict, fewer timeout.")

# Halts.
HALT_RADIUS = threshold("halt_radius", 0.03, "m",
    "Largest distance that a halted arm may move away from its stopping point until the end. Action noise moves the "
    "arm by less than 1 cm.",
    "Larger: more arms stay in place to the end; more early_halt and phase_conflict, fewer timeout.")
DRIFT = threshold("drift", 0.002, "m/s",
    "Largest speed at which a halted arm may drift in addition. An observer cannot see such a drift, and it leads "
    "nowhere within a trial. The arm drifts this fast if the policy's actions are noise around zero.",
    "Larger: more creeping arms count as halted; more early_halt and phase_conflict, fewer timeout.")
COME_TO_REST = threshold("come_to_rest", 0.005, "m",
    "After slowing down, an arm has come to rest if it moves by at most this distance until the end, apart from drift. "
    "An arm that creeps at 4 mm/s or more has not come to rest.",
    "Larger: more slow stretches end at rest; more early_halt and phase_conflict, fewer timeout.")
PAUSES_VARY = threshold("pauses_vary", 1.5, "1",
    "If a policy has made long pauses, a stop at the end is a halt only if it is more than this many times as long as "
    "the longest earlier pause.",
    "Larger: more stops at the end are pauses; fewer early_halt, more timeout.")
TREMBLE_TIME = threshold("tremble_time", 8.0, "s",
    "An arm that stays within halt_radius until the end for this time has halted, even if it is never completely "
    "still. Policies without a fault moved on after at most 6.5 s.",
    "Larger: an arm must tremble in place for longer; fewer early_halt and phase_conflict, more timeout.")
OVER_GOAL = threshold("over_goal", 0.06, "m",
    "A held object has been brought to its target region if its horizontal distance to the center of the region is at "
    "most this large. Wider regions count up to their edge.",
    "Larger: more objects are held at their target region; more timeout for grippers that never open, fewer "
    "early_halt.")
SEARCH_STEP = threshold("search_step", 0.5, "s",
    "Step of the search for the time at which a halt, or motion back and forth, begins. A shorter step finds the same "
    "beginnings slightly earlier.",
    "Larger: halts and motion back and forth begin later or are missed; fewer early_halt and phase_conflict, more "
    "timeout.",
    listed=False)

# Other worlds.
RESTS_ON_GAP = threshold("rests_on_gap", 0.01, "m",
    "In LIBERO, an object is on a target if the gap between the object and the target's support surface is at most "
    "this large. A gap is allowed because surfaces are uneven and contacts are not required.",
    "Larger: more objects are on their targets; more causal_confusion of finished steps, fewer execution_failure.",
    listed=False)

# The second pass: the rule that explains the first attempts of a policy (docs/second-pass.md).
HIGHEST_STRENGTH = threshold("highest_strength", 0.99, "1",
    "Largest strength of a rule that is tried. No run has enough trials to distinguish a larger strength.",
    "Larger: rules without exceptions cost less, others are unchanged; more lexical_kinematic_shortcut and "
    "visual_layout_bias, fewer wrong_object.",
    listed=False)
LOWEST_ERROR_RATE = threshold("lowest_error_rate", 0.001, "1",
    "Smallest error rate of confusion that is tried. It is above zero, so that a single error remains possible.",
    "Larger: confusion costs more for a policy that seldom errs; more lexical_kinematic_shortcut and "
    "visual_layout_bias, fewer wrong_object.",
    listed=False)
HIGHEST_ERROR_RATE = threshold("highest_error_rate", 0.99, "1",
    "Largest error rate of confusion that is tried, even if guessing errs more often. It is below 1, so that a single "
    "correct attempt remains possible.",
    "Larger: confusion costs less for a policy that nearly always errs; more wrong_object, fewer "
    "lexical_kinematic_shortcut and visual_layout_bias.",
    listed=False)
ORDER_TRIALS = threshold("order_trials", 3, "1",
    "Number of wrong first attempts at later steps that a policy must make to be said to confuse the order. This "
    "explanation must also fit the attempts at least as well as any other rule. If there are only one or two such "
    "attempts, they may be at a favorite slot instead.",
    "Larger: fewer policies mistake the order; fewer order_violation and causal_confusion, more visual_layout_bias "
    "and lexical_kinematic_shortcut.",
    listed=False)
OTHER_TASKS = threshold("other_tasks", 2, "1",
    "If a task's own trials cannot prove a rule, the rule counts there only if it is proven in at least this number "
    "of other tasks. A proof in one task may be chance.",
    "Larger: fewer rules carry over from other tasks; fewer visual_layout_bias and order_violation, more "
    "wrong_object.",
    listed=False)
ONE_ATTEMPT = threshold("one_attempt", 3.0, "1",
    "Weight of one first attempt that only one of two rules predicts [nats]. The probability of the attempt is nearly "
    "1 under that rule and equals the threshold slip under the other rule, and -log(slip) is 3.0.",
    "Larger: the rule over all tasks decides more attempts that fit several rules; more of that rule's label, fewer "
    "wrong_object.",
    listed=False)
CLEARLY = threshold("clearly_better", 2.0, "1",
    "Margin of a clear decision [nats], which corresponds to odds of 7. A kind of rule is the policy's rule if it "
    "explains all tasks better than any other kind by this margin. A habit is rejected if confusion explains a task "
    "better by this margin.",
    "Larger: fewer policies have one rule in all tasks; more wrong_object, fewer lexical_kinematic_shortcut and "
    "visual_layout_bias.",
    listed=False)

# The instruction effect, and the cues that determine the attempts instead of the instruction.
LEAST_PAIRS = threshold("instruction_pairs", 10, "1",
    "Number of pairs that a run needs to show that a policy does not use the instruction. With fewer pairs, chance "
    "cannot be excluded.",
    "Larger: fewer policies are found not to use the instruction; fewer visual_layout_bias, more wrong_object.",
    listed=False)
USED = threshold("instruction_used", 0.5, "1",
    "Instruction effect of a policy that picks one of two objects at random. A policy is said not to use the "
    "instruction only if its instruction effect is significantly lower.",
    "Larger: more policies are found not to use the instruction, and fewer to have a favorite kind of object; more "
    "visual_layout_bias in betterbench's own scenes, fewer in other worlds.",
    listed=False)
LEVEL = threshold("instruction_level", 0.025, "1",
    "Significance level of the one-sided tests that the policy does not use the instruction. It is that of one side of "
    "a 95 % interval.",
    "Larger: more policies are found not to use the instruction; more visual_layout_bias, fewer wrong_object.",
    listed=False)
LEAST_ASKED = threshold("favorite_asked", 3, "1",
    "A policy can have a favorite kind of object only if at least this many other kinds were requested and the policy "
    "took the favorite instead. Confused words cannot explain so many cases.",
    "Larger: fewer policies have a favorite kind of object; fewer visual_layout_bias, more wrong_object.",
    listed=False)
NEARLY_ALL = threshold("nearly_all", 0.9, "1",
    "Fraction of the first attempts that a slot, kind, color or distance must explain to be named as the deciding cue. "
    "A confused word must also explain this fraction. The remaining tenth may be slips.",
    "Larger: fewer cues and confused words are named; a visual_layout_bias keeps its label, and its evidence names a "
    "place less often.",
    listed=False)

# Thresholds for conclusions from several trials, and for the power matrix.
SHARE_OF_ALL = threshold("share_of_all", 0.8, "1",
    "A conclusion about a failure mode names a specific form of failure only if at least this fraction of the policy's "
    "trials with this failure mode have the form.",
    "Larger: no label changes; conclusions are less specific.",
    listed=False)
REPLAY_LIMIT = threshold("replay_limit", 0.25, "1",
    "Largest success rate that replayed motion may have on a variation that it does not solve. Replays sometimes "
    "succeed by chance, because the positions of the slots vary.",
    "Larger: no label changes; more variations count as evidence of an ability.")
FAILS_AT = threshold("fails_at", 0.5, "1",
    "A pretender (a policy without the tested ability) fails a variation if its success rate is at most this large. "
    "This is the rate of a coin flip.",
    "Larger: no label changes; more variations count as evidence of an ability.")

# Evidence from the joint states of a real arm (betterbench.real). The diagnosis of simulated trials does not use these
# values, so its stored results do not list them. The gripper opening is given in percent of the travel of the jaw,
# where 0 is closed and 100 is open.
JAW_MOVES = threshold("jaw_moves", 5.0, "%",
    "The jaw has closed or opened if its opening changed by at least this much. The encoder resolves 0.08 %, and a "
    "printed jaw has a backlash of about 1 %. For an SO-101, 5 % are 5 mm at the fingertip.",
    "Larger: fewer grasps are found in joint states; fewer behavioral_inertia and execution_failure of a real arm, "
    "more early_halt.",
    listed=False)
JAW_RESTS = threshold("jaw_rests", 1.5, "%",
    "A jaw has stopped if its opening changes by at most this much within stop_time. The backlash and the flicker of "
    "an encoder are smaller.",
    "Larger: a slowly closing jaw counts as stopped; fewer behavioral_inertia of a real arm, more execution_failure.",
    listed=False)
JAW_GAP = threshold("jaw_gap", 4.0, "%",
    "A stopped jaw is held open by an object if its measured opening differs from its command by at least this much. "
    "The empty jaw of the twin follows its command within 0.1 %. Around a fruit, it stops 8 to 9 % short of the "
    "command.",
    "Larger: if the load is unknown, fewer grasps have an object; fewer success and more contradictions with the "
    "judges' entries, which leave a trial unscored.",
    listed=False)
JAW_LOAD = threshold("jaw_load", 0.1, "1",
    "A jaw presses on an object if the load of the gripper's motor is at least this fraction of its maximum. The "
    "value was chosen and has not been measured on the arm. The friction of the motor is 0.052 of 2.94 N m, and "
    "LeRobot limits the gripper to half of its torque.",
    "Larger: if the load is known, fewer grasps have an object; more behavioral_inertia of a real arm.",
    listed=False)
JAW_SHUT = threshold("jaw_shut", 15.0, "%",
    "Largest opening (26 mm) at which no object of the fruit basket fits between the jaws. The narrowest object is "
    "35 mm wide, which is 22 %.",
    "Larger: more grasps are empty; more behavioral_inertia and phase_conflict of a real arm.",
    listed=False)
JAW_FULLY_SHUT = threshold("jaw_fully_shut", 4.0, "%",
    "Largest opening at which the jaws may touch each other, so that a load is not evidence of an object. The "
    "calibration of the closed jaw differs by up to 2 % from one time to the next.",
    "Larger: more grasps with a load are empty; more behavioral_inertia of a real arm.",
    listed=False)
HELD_SHARE = threshold("held_share", 0.5, "1",
    "If the policy does not answer in at least this fraction of the control steps, the trial counts as a failure of "
    "the system.",
    "Larger: fewer policy_error of a real arm, more early_halt and phase_conflict.",
    listed=False)
# fmt: on
