"""The tasks of the suite, one short file each, in the order of the suite's table."""

from betterbench.tasks.suite import (  # isort: skip - the order is that of the suite's table
    desk_meeting,
    breakfast_table,
    fruit_lunch,
    fast_food,
    tidy_desk,
    morning_coffee,
    office_drawer,
    cheeseburger,
    seasoning_rack,
    dinner_plates,
)

__all__ = [
    "breakfast_table",
    "cheeseburger",
    "desk_meeting",
    "dinner_plates",
    "fast_food",
    "fruit_lunch",
    "morning_coffee",
    "office_drawer",
    "seasoning_rack",
    "tidy_desk",
]
