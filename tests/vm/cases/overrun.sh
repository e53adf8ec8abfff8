# A job that takes 2 ms too long: each miss policy does exactly what it says.
tell /tmp/overrun vm_loads --case overrun
