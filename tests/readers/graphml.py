"""Reads a GraphML file with networkx and prints its edges; with a second file, writes the graph there, as networkx does.

Usage: graphml.py FILE.graphml [OTHER.graphml]
"""

import json
import sys

import networkx

graph = networkx.read_graphml(sys.argv[1], node_type=int)
if len(sys.argv) > 2:
    networkx.write_graphml(graph, sys.argv[2])
edges = sorted([min(a, b), max(a, b), weight] for a, b, weight in graph.edges(data="weight"))
print(json.dumps({"directed": graph.is_directed(), "nodes": sorted(graph), "edges": edges}))
