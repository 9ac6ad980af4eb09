"""Figures of the documentation: result files, the tables made from them, and their repetition.

record.py   one file of results/*.json
plan.py     what is measured, and how (results/plan.toml)
robert.py   the program that measures
measure.py  makes a record from a plan's entry
inputs.py   hashes of what a measurement depends on
table.py    a table of results/tables.toml, from records, as Markdown
dots.py     dots on a logarithmic axis, as SVG
curves.py   error over time, as SVG
trend.py    runs over the amount of data with fitted lines, as SVG
cards.py    the figures on the cards of the built-in models
page.py     the marked blocks of the Markdown pages
verify.py   random cells, measured again
"""
