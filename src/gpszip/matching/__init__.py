"""Map matching on a known road network, and what builds on it.

``match`` finds the roads of tracks, ``live`` follows an agent sample by sample, and ``patch`` fills
gaps over roads. ``index`` prepares the network, ``viterbi`` finds the cheapest path of a hidden
Markov model, ``scales`` estimates the model's scales from the log, and ``assemble`` builds the
result.
"""
