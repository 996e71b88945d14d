"""The diagnostic protocol on a real arm: randomized trials, safety limits, records, and outcomes entered by people.

- ``sheet``: the printed marker sheet of the scene, and the measurement of the front camera's pose.
- ``plan``: the immutable plan of a protocol: conditions and policies in randomized blocks, and a code for each trial.
- ``outcomes``: the outcomes that a person can enter for a trial, with the definitions shown on the pages.
- ``record``: the folder of a protocol: journal, samples, videos, and the outcomes that people entered. Reading the
  folder does not need a simulator.
- ``signals``, ``labels``: signals computed from joint states, and the label of a trial.
- ``agreement``, ``results``, ``report_page``: agreement between raters, diagnostic matrices, and the results page.
- ``judging``, ``judge_page``: the queue of trials that a judge rates, and the web page of the judge.
"""
