use mesa_hal::sim::machines;
#[test]
fn replay() {
    let dir = "/work/shared/module-transcripts";
    let mut names: Vec<_> = std::fs::read_dir(dir).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).filter(|n| n.starts_with("im")||n.starts_with("in0")||n.starts_with("in1")).collect();
    names.sort();
    for name in names {
        let text = std::fs::read_to_string(format!("{dir}/{name}")).unwrap();
        let inm = text.contains("INM_CONTROL");
        let mut fpga = if inm { machines::i7i97_inm_outm(1) } else { machines::i7i97(1) };
        for n in 0..16 { fpga.set_input(n, true); }
        let (mut n, mut bad) = (0, 0);
        let mut watching=false;
        for line in text.lines().filter(|l| !l.starts_with('#')) {
            let w: Vec<&str> = line.split_whitespace().collect();
            let at: u64 = w[0].parse().unwrap();
            let reg = |r: &str| -> Option<u16> { let (m, r) = r.split_once('_').unwrap(); let base = if m=="INM" {0x8500} else {0x8000}; Some(base + match r { "CONTROL"=>0,"FILTER"=>0x100,"FILTERED"=>0x200,"RAW"=>0x300,"MPG"=>0x400,"ALT[1]"=>return Some(0x1204),"DIR[1]"=>return Some(0x1104),_=>return None}) };
            fpga.advance_to(at);
            let hex = |s: &str| u32::from_str_radix(&s[2..],16).unwrap();
            match w[1] {
                "write" => if let Some(r) = reg(w[2]) { fpga.write_register(r, hex(w[3])); },
                "read" => { let r = reg(w[2]).unwrap(); let v = fpga.read_register(r); n+=1; if v != hex(w[3]) { bad+=1; if bad<6 { println!("{name}: {line}: got {v:08X}"); } } },
                "input" => fpga.set_input(w[2].parse().unwrap(), w[3]=="0"),
                "drive" => fpga.set_input(w[2][2..].parse().unwrap(), w[3]=="1"),
                "pin" => { n+=1; let line: u8 = w[2][6..].parse().unwrap(); let i = fpga.inputs().unwrap(); let v = w[3]=="1"; if w[3]!="z" && (i.address_line(at, line) != v || (watching && i.address_line(at-1, line)==v)) {bad+=1;  println!("{name}: {w:?}"); } if at>180 {watching=true;}}
                "note" => {},
                _ => panic!("{line}"),
            }
        }
        println!("{name}: compared {n}, differing {bad}");
    }
}
