"""The diagnostic protocol on a real arm: randomized trials, safety limits, records, and outcomes entered by people.

- ``sheet``: the printed markers of the scene, and the pose of the front camera.
- ``plan``: the frozen plan of a protocol: conditions and policies in randomized blocks, and a code for each trial.
- ``outcomes``: what a person can enter about a trial, with the definitions that pages show.
- ``record``: the folder of a protocol: journal, samples, films and entries of people. Reading it starts no simulator.
- ``signals``, ``labels``: signals computed from joint states, and the label of a trial.
- ``agreement``, ``results``, ``report_page``: agreement of people, matrices, and the page of the results.
- ``judging``, ``judge_page``: the queue and the page of a judge.
"""
