//! The next steps after bus errors.

crate::advice_texts! {
    /// All constants of this module.
    ALL;
    CHECK_BOARD: Board, "check the board's power, cable, IP address and jumpers, or allow a longer deadline";
    CHECK_HOST: Host, "look for interrupts, power saving and other traffic, or allow a longer deadline";
    CHECK_ADDRESS: Board, "check the address and the port";
    CHECK_ADDRESS_AND_WAY: Board, "check the address and the port, and what relays or filters packets on their way";
    CHECK_INTERFACE: Network, "check that the network interface is up and in the same network, and the board's IP address and cable";
    FIND_OTHER_PROGRAM: OtherProgram, "find out whether another program communicates with this board";
    END_OTHER_PROGRAM: OtherProgram, "end the other program (LinuxCNC, mesaflash, another driver), also on other hosts";
    OPEN_FIREWALL: Firewall, "LinuxCNC on this computer keeps its board for itself: end it. If it has ended and left its firewall behind: `sudo iptables -F hm2-eth-rules-output`; else it is another rule of `sudo iptables -S`";
    SHORTEN_LIST: Module, "use shorter lists";
    START_LIST: Module, "start the list, and run nothing else before its reply is taken";
    PREPARE_LIST: Module, "prepare the list on this bus";
    CHECK_SLOT: Board, "check that the board is seated in its slot and has power; after a reload of its FPGA the computer must be restarted";
    SHORTEN_PERIOD: Host, "use a shorter period, or let the host pace the cycle";
}
