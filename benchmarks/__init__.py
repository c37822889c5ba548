"""What `rollingroad bench` measures: modules with `BENCHMARKS`, name -> function that returns rows."""
