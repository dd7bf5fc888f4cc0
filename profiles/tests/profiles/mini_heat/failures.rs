//! Each failure of the MINI's heaters, in each state, and when it is noticed.
