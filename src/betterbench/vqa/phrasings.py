"""How questions are worded: several ways for each family, chosen by a question's identifier and not by its answer."""

from __future__ import annotations

from betterbench.errors import UnknownNameError
from betterbench.vqa.question import Candidate, hash_number

PHRASINGS: dict[str, tuple[str, ...]] = {
    "box of": (
        "What is the bounding box of {thing}?",
        "Give the box around {thing}.",
        "Where is {thing}? Answer with its bounding box.",
        "Locate {thing} and return its box.",
        "Which box encloses the visible part of {thing}?",
        "Draw a tight box around {thing}. What are its edges?",
    ),
    "point at": (
        "Point at {thing}.",
        "Give one point on {thing}.",
        "Which pixel lies on {thing}?",
        "Touch {thing} in the image. Where do you touch it?",
        "Mark {thing} with a single point.",
        "Name the coordinates of a point on {thing}.",
    ),
    "what is in box": (
        "What is in the box {box}?",
        "Which object does the box {box} enclose?",
        "Look at the region {box}. What is there?",
        "Name the object in {box}.",
        "The box {box} is drawn around one object. Which one?",
        "Which of these things is at {box}?",
    ),
    "how many of kind": (
        "How many {things} can you see?",
        "Count the {things} in the image.",
        "What is the number of {things} in view?",
        "How many {things} are visible?",
        "How many {things} does the image show?",
    ),
    "how many of group": (
        "How many {things} can you see in all?",
        "Count all {things} in the image.",
        "Taken together, how many {things} are in view?",
        "How many {things} does the image show in total?",
        "What is the total number of visible {things}?",
    ),
    "how many inside": (
        "How many objects are in {target}?",
        "Count what lies inside {target}.",
        "How many things does {target} hold?",
        "What is the number of objects in {target}?",
        "How many objects are there inside {target} at this moment?",
    ),
    "side in image": (
        "In the image, is {a} to the {side} of {b}?",
        "Does {a} appear to the {side} of {b} in this picture?",
        "Looking at the image, do you see {a} on the {side} of {b}?",
        "Is {a} farther to the {side} in the image than {b}?",
        "As the camera sees it, is {a} to the {side} of {b}?",
    ),
    "closer to camera": (
        "Which is closer to the camera, {a} or {b}?",
        "Of {a} and {b}, which one is nearer to the camera?",
        "Which is nearer to the viewer: {a} or {b}?",
        "Compare {a} and {b}: which has the smaller distance from the camera?",
        "Which of the two is in front for the camera, {a} or {b}?",
    ),
    "side for robot": (
        "As the robot sees it from its base, is {a} to the {side} of {b}?",
        "From the robot's own point of view, is {a} on the {side} of {b}?",
        "The robot looks out from its base over the table. Is {a} to its {side} of {b}?",
        "In the robot's frame, is {a} farther to the {side} than {b}?",
        "For the robot itself, does {a} lie to the {side} of {b}?",
    ),
    "closer to robot": (
        "Which is closer to the robot's base, {a} or {b}?",
        "Of {a} and {b}, which one is nearer to where the robot stands?",
        "Which would the arm have to reach out less for, measured from its base: {a} or {b}?",
        "Compare the distances from the base of the robot: is {a} or {b} nearer?",
        "Which is nearer to the foot of the robot, {a} or {b}?",
    ),
    "side of anchor": (
        "Seen by somebody who sits in front of {b}, is {a} {side} it?",
        "Has {a} been put {side} {b}, as its user sees it?",
        "Somebody sits in front of {b}. Does {a} lie {side} {b} for that person?",
        "Is the place of {a} {side} {b}, from the side where one sits?",
        "For a person in front of {b}, is {a} arranged {side} it?",
    ),
    "outermost": (
        "Which of these is {side} in the image: {things}?",
        "Look at {things}. Which one is the {side}?",
        "Which object is {side} in the picture, of {things}?",
        "Name the {side} of these in the image: {things}.",
        "Of {things}, what appears {side}?",
    ),
    "is it in": (
        "Is {a} {where}?",
        "At this moment, is {a} {where}?",
        "Has {a} been placed {where}?",
        "Can {a} be found {where}?",
        "Look at {a}: is it {where}?",
    ),
    "where is it": (
        "Where is {a}?",
        "What is the place of {a} now?",
        "Say where {a} is.",
        "In which of these places is {a}?",
        "At this moment, where can {a} be found?",
    ),
    "what is in": (
        "What is {where}?",
        "Which object can be found {where}?",
        "Name what is {where}.",
        "What has been put {where}?",
        "Look closely: what is {where} now?",
    ),
    "what is on": (
        "What lies directly on {base}?",
        "Which object rests right on top of {base}?",
        "Name the thing that rests directly on {base}.",
        "What touches {base} from above?",
        "What is the next thing up from {base}?",
    ),
    "is it on": (
        "Does {a} lie directly on {base}?",
        "Is {a} right on top of {base}, with nothing in between?",
        "Does {base} carry {a} directly?",
        "Is {a} the next thing up from {base}?",
        "Does {a} rest right on {base}?",
    ),
    "order": (
        "In which order do {things} lie on {base}, from below?",
        "Name what lies on {base} from the bottom to the top: {things}.",
        "How is the stack on {base} built, lowest first, of {things}?",
        "Read the stack on {base} upward: in which order come {things}?",
        "Which order of {things} do you see above {base}, counted from the lowest?",
    ),
    "higher": (
        "Which is higher above the table, {a} or {b}?",
        "Of {a} and {b}, which one lies higher up?",
        "Which of the two is at the greater height: {a} or {b}?",
        "Compare the heights above the table: {a} or {b}, which is higher?",
        "Which lies farther up, {a} or {b}?",
    ),
    "is it open": (
        "Is {a} open?",
        "Does {a} stand open?",
        "Has {a} been pulled out?",
        "Could something be put into {a} as it is now, because it is open?",
        "Look at {a}: is it drawn out?",
    ),
    "gripper open": (
        "Is the gripper open or closed?",
        "What is the state of the gripper: open or closed?",
        "How are the fingers of the gripper, open or closed?",
        "Are the fingers of the robot apart (open) or together (closed)?",
        "Open or closed: how is the gripper?",
    ),
    "what is held": (
        "What is the gripper holding?",
        "Which object is in the gripper?",
        "What does the robot carry at this moment?",
        "Name the object that the robot has in its gripper.",
        "What has the robot picked up and not yet let go?",
    ),
    "is it held": (
        "Is the gripper holding {a}?",
        "Is {a} in the gripper?",
        "Does the robot carry {a} at this moment?",
        "Does the robot have {a} between its fingers now?",
        "Is {a} what the robot holds now?",
    ),
    "fallen over": (
        "Has {a} fallen over?",
        "Does {a} lie on its side?",
        "Did {a} topple?",
        "Is {a} lying where it should be standing?",
        "Has something knocked {a} over?",
    ),
    "what is it doing": (
        "What is the robot doing?",
        "Describe what the robot is doing at this moment.",
        "Which of these is the robot doing now?",
        "What is going on: what does the arm do?",
        "What action of the robot does the image show?",
    ),
    "is step done": (
        'The robot was told: "{instruction}" Has this step been done: {step}?',
        'Instruction: "{instruction}" Is the step "{step}" completed?',
        'Of the instruction "{instruction}", is this part finished: {step}?',
        'Somebody asked the robot: "{instruction}" Did it already {step}?',
        'With the instruction "{instruction}" in mind: is it done to {step}?',
    ),
    "what is done": (
        'The robot was told: "{instruction}" What of it has been done?',
        'Instruction: "{instruction}" How much of it is completed?',
        'Of the instruction "{instruction}", which steps are finished?',
        'Somebody asked the robot: "{instruction}" What has it achieved so far?',
        'How far has the robot come with "{instruction}"?',
    ),
    "what is next": (
        'The robot was told: "{instruction}" What comes next?',
        'Instruction: "{instruction}" What does the robot have to do now?',
        'Which step of "{instruction}" is due?',
        'Somebody asked the robot: "{instruction}" What is the next step?',
        'To go on with "{instruction}", what should the robot do?',
    ),
    "is it there": (
        "Is there {thing} in this scene?",
        "Can you see {thing}?",
        "Does the image show {thing}?",
        "Is {thing} anywhere in view?",
        "Look for {thing}: is there one?",
    ),
    "is it a": (
        "Is the object in {box} {thing}?",
        "Does the box {box} enclose {thing}?",
        "Look at {box}: is that {thing}?",
        "Would you call what is in {box} {thing}?",
        "Is it {thing} that the box {box} is drawn around?",
    ),
    "can it be done": (
        'The robot is told: "{instruction}" Is everything there that this asks for?',
        'Instruction: "{instruction}" Does the scene hold every object that it names?',
        'Could the robot carry out "{instruction}" with the objects that are there?',
        'Are all things of the instruction "{instruction}" present?',
        'Somebody asks: "{instruction}" Is nothing missing for that?',
    ),
    # Questions about decisive moments.
    "box for next step": (
        'The robot is told: "{instruction}" In which of these boxes is what it has to pick up or move now?',
        'Instruction: "{instruction}" Which box holds the object that the gripper should go to next?',
    ),
    "box of named": (
        "Which of these boxes is around {thing}?",
        "In which of these boxes is {thing}?",
    ),
    "what is at gripper": (
        "Which object is in the box {box}, at which the gripper is?",
        "The gripper goes for what is in the box {box}. What is it?",
    ),
}
"""Phrasings by family; words in braces are filled in."""


def phrase(candidate: Candidate, *, seed: int, number: int | None = None) -> str:
    """Return the text of a question: phrasing ``number`` of its family, or the one that its identifier chooses.

    Raises:
        UnknownNameError: If there is no such family.
    """
    if candidate.family not in PHRASINGS:
        raise UnknownNameError("family of questions", candidate.family, PHRASINGS)
    ways = PHRASINGS[candidate.family]
    chosen = hash_number("phrasing", candidate.id(seed)) if number is None else number
    return ways[chosen % len(ways)].format(**candidate.words)
