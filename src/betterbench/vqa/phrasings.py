"""Wordings of questions.

Each family of questions has several wordings. A hash that does not depend on the answer chooses one of them.

Each wording states its frame of reference: the image, the camera, the robot's base, or a person in front of an object.
Image regions are called bounding boxes, because scenes contain boxes as objects.
"""

from __future__ import annotations

from betterbench.errors import UnknownNameError
from betterbench.vqa.question import Candidate

PHRASINGS: dict[str, tuple[str, ...]] = {
    "box of": (
        "What is the bounding box of {thing}?",
        "Give the bounding box of {thing}.",
        "Where is {thing} in the image? Answer with its bounding box.",
        "Locate {thing} and return its bounding box.",
        "What bounding box encloses the visible part of {thing}?",
        "Give the coordinates of a tight bounding box around {thing}.",
    ),
    "point at": (
        "Point to {thing} in the image.",
        "Give the coordinates of one point on {thing}.",
        "Name one pixel that belongs to {thing}.",
        "Where would you click in the image to select {thing}?",
        "Mark {thing} with a single point.",
        "Where is {thing} in the image? Answer with one point on it.",
    ),
    "what is in box": (
        "What is in the bounding box {box}?",
        "Which object does the bounding box {box} enclose?",
        "Look at the image region {box}. Which object is there?",
        "Name the object in the image region {box}.",
        "The bounding box {box} is drawn around one object. Which one is it?",
        "Which of these objects is in the bounding box {box}?",
    ),
    "how many of kind": (
        "How many {things} can you see?",
        "Count the {things} in the image.",
        "How many {things} are in view?",
        "How many {things} are visible?",
        "How many {things} does the image show?",
    ),
    "how many of group": (
        "How many {things} can you see in all?",
        "Count all {things} in the image.",
        "How many {things} are there in the image altogether?",
        "How many {things} does the image show in total?",
        "What is the total number of visible {things}?",
    ),
    "how many inside": (
        "How many objects are in {target}?",
        "Count the objects inside {target}.",
        "How many objects does {target} contain?",
        "What is the number of objects in {target}?",
        "How many objects are inside {target} right now?",
    ),
    "side in image": (
        "In the image, is {a} to the {side} of {b}?",
        "Does {a} appear to the {side} of {b} in this image?",
        "Looking at the image, is {a} to the {side} of {b}?",
        "Is {a} farther {side} in the image than {b}?",
        "From the camera's viewpoint, is {a} to the {side} of {b}?",
    ),
    "closer to camera": (
        "Which is closer to the camera, {a} or {b}?",
        "Of {a} and {b}, which one is nearer to the camera?",
        "Which object is nearer to the camera: {a} or {b}?",
        "Which has the shorter distance to the camera, {a} or {b}?",
        "Measured from the camera, which is closer: {a} or {b}?",
    ),
    "side for robot": (
        "From the robot's base, facing the table, is {a} to the {side} of {b}?",
        "The robot faces the table from its base. Seen from there, is {a} to the {side} of {b}?",
        "In the frame of the robot's base, which faces the table, is {a} farther to the {side} than {b}?",
        "If you looked from the robot's base out over the table, would {a} be to the {side} of {b}?",
        "Take the viewpoint of the robot's base, looking toward the table. Is {a} to the {side} of {b}?",
    ),
    "closer to robot": (
        "Which is closer to the robot's base, {a} or {b}?",
        "Of {a} and {b}, which one is nearer to the robot's base?",
        "Measured along the table from the robot's base, which is closer: {a} or {b}?",
        "Compare the distances from the base of the robot: is {a} or {b} nearer?",
        "Which object has the shorter distance to the base of the robot, {a} or {b}?",
    ),
    "side of anchor": (
        "For a person sitting in front of {b}, is {a} {side} it?",
        "From the viewpoint of someone using {b}, is {a} {side} it?",
        "Someone sits in front of {b}. For that person, is {a} {side} it?",
        "As a person in front of {b} sees it, is {a} {side} {b}?",
        "Imagine sitting in front of {b}. Is {a} {side} it?",
    ),
    "outermost": (
        "Which of these is {side} in the image: {things}?",
        "Look at {things}. Which one is {side} in the image?",
        "Of {things}, which one is {side} in the image?",
        "Name the {side} of these objects in the image: {things}.",
        "Among {things}, which one appears {side} in the image?",
    ),
    "is it in": (
        "Is {a} {where}?",
        "Right now, is {a} {where}?",
        "Has {a} been placed {where}?",
        "Does the image show {a} {where}?",
        "Look at {a}. Is it {where}?",
    ),
    "where is it": (
        "Where is {a}?",
        "Where is {a} right now?",
        "Which of these says where {a} is?",
        "In which of these places is {a}?",
        "Where is {a} located at this moment?",
    ),
    "what is in": (
        "What is {where}?",
        "Which object, if any, is {where}?",
        "Name the object that is {where}, if there is one.",
        "What has been put {where}?",
        "What can you see {where}?",
    ),
    "what is on": (
        "What lies directly on {base}?",
        "Which object, if any, lies directly on top of {base}?",
        "Name the object that lies directly on {base}, if there is one.",
        "What is directly on top of {base}?",
        "In the stack, what comes directly above {base}?",
    ),
    "is it on": (
        "Does {a} lie directly on {base}?",
        "Is {a} directly on top of {base}, with nothing in between?",
        "Is {a} stacked directly on {base}?",
        "Is {a} the object that lies directly on {base}?",
        "Does {a} rest directly on {base}?",
    ),
    "order": (
        "In which order are {things} stacked on {base}, from bottom to top?",
        "List {things} in the order in which they lie on {base}, from bottom to top.",
        "What is the stacking order of {things} on {base}, lowest first?",
        "Going up from {base}, in which order do {things} come?",
        "Which order of {things} on {base} is correct, counted from the bottom?",
    ),
    "higher": (
        "Which is higher above the table, {a} or {b}?",
        "Of {a} and {b}, which one is higher above the table?",
        "Which of the two is at the greater height above the table: {a} or {b}?",
        "Compare the heights above the table: is {a} or {b} higher?",
        "Measured from the tabletop, which is higher: {a} or {b}?",
    ),
    "is it open": (
        "Is {a} open?",
        "Is {a} pulled out?",
        "Is {a} open right now?",
        "Is {a} open, so that something could be put into it?",
        "Look at {a}. Is it open?",
    ),
    "gripper open": (
        "Is the gripper open or closed?",
        "What is the state of the gripper: open or closed?",
        "Are the fingers of the gripper open or closed?",
        "Are the robot's fingers apart (open) or together (closed)?",
        "Is the robot's gripper open, or is it closed?",
    ),
    "what is held": (
        "What is the gripper holding?",
        "Which object, if any, is in the gripper?",
        "What is the robot holding right now?",
        "Name the object that the robot has in its gripper, if there is one.",
        "What is held between the robot's fingers?",
    ),
    "is it held": (
        "Is the gripper holding {a}?",
        "Is {a} in the gripper?",
        "Is the robot holding {a} right now?",
        "Does the robot have {a} between its fingers?",
        "Is {a} being held by the robot?",
    ),
    "fallen over": (
        "Has {a} fallen over?",
        "Is {a} lying on its side?",
        "Has {a} toppled over?",
        "Is {a} lying down instead of standing upright?",
        "Has {a} been knocked over?",
    ),
    "what is it doing": (
        "What is the robot doing?",
        "Which of these describes what the robot is doing?",
        "What is the robot doing right now?",
        "What is the robot arm doing?",
        "Which action of the robot does the image show?",
    ),
    "is step done": (
        'The robot was told: "{instruction}" Has it already done this step: {step}?',
        'Instruction: "{instruction}" Is the step "{step}" completed?',
        'The robot follows the instruction "{instruction}" Is this part of it finished: {step}?',
        'Someone asked the robot: "{instruction}" Has the robot already done this: {step}?',
        'The instruction is "{instruction}" Is the step "{step}" done?',
    ),
    "what is done": (
        'The robot was told: "{instruction}" Which parts of this has it done so far?',
        'Instruction: "{instruction}" Which of its steps are completed?',
        'The robot follows the instruction "{instruction}" Which steps are finished?',
        'Someone asked the robot: "{instruction}" What has the robot completed so far?',
        'How much of the instruction "{instruction}" has the robot carried out?',
    ),
    "what is next": (
        'The robot was told: "{instruction}" What should it do next?',
        'Instruction: "{instruction}" What does the robot have to do next?',
        'Which step of the instruction "{instruction}" comes next?',
        'Someone asked the robot: "{instruction}" What is the next step?',
        'To continue with the instruction "{instruction}", what should the robot do next?',
    ),
    "is it there": (
        "Is there {thing} in this image?",
        "Can you see {thing}?",
        "Does the image show {thing}?",
        "Is {thing} visible anywhere?",
        "Look for {thing}. Is there one in the image?",
    ),
    "is it a": (
        "Is the object in the bounding box {box} {thing}?",
        "Does the bounding box {box} enclose {thing}?",
        "Look at the image region {box}. Is the object there {thing}?",
        "The bounding box {box} is drawn around an object. Is it {thing}?",
        "Does the image region {box} show {thing}?",
    ),
    "can it be done": (
        'The robot is told: "{instruction}" Are all the objects that this requires in the scene?',
        'Instruction: "{instruction}" Does the scene contain every object that it names?',
        'Could the robot carry out the instruction "{instruction}" with the objects in the scene?',
        'Are all objects that the instruction "{instruction}" names present?',
        'Someone tells the robot: "{instruction}" Is every object that this requires present?',
    ),
    # Questions about decisive moments.
    "box for next step": (
        'The robot is told: "{instruction}" Which bounding box contains the object that it should pick up or move?',
        'Instruction: "{instruction}" Which bounding box contains the object that the gripper should go to next?',
    ),
    "box of named": (
        "Which of these bounding boxes is drawn around {thing}?",
        "In which of these bounding boxes is {thing}?",
    ),
    "what is at gripper": (
        "The gripper is at the bounding box {box}. Which object is in it?",
        "The gripper closes at the bounding box {box}. What is the object there?",
    ),
}
"""Wordings of each family of questions, with placeholders in braces."""


def phrase(candidate: Candidate, *, number: int) -> str:
    """Return the text of a question in one of the wordings of its family.

    The wording is chosen by an index, modulo the number of wordings.

    Raises:
        UnknownNameError: If there is no such family.
    """
    if candidate.family not in PHRASINGS:
        raise UnknownNameError("question family", candidate.family, PHRASINGS)
    ways = PHRASINGS[candidate.family]
    return ways[number % len(ways)].format(**candidate.words)
