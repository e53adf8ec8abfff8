# Haptic devices on the kernel's USB: found, without the right, pulled out and put back.
tell /tmp/usb vm_usb_devices
