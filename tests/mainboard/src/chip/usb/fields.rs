//! The bit fields of the OTG_FS registers, RM0090 section 34.16; where RM0390 section 31 differs,
//! the field says so.

use rigless::soc::{Access, FieldSpec, WriteModify};

/// A field that software reads and writes.
const fn rw(name: &'static str, bit: u8, width: u8) -> FieldSpec {
    FieldSpec::new(name, bit, width, Access::ReadWrite)
}

/// A field that only the core changes.
const fn ro(name: &'static str, bit: u8, width: u8) -> FieldSpec {
    FieldSpec::new(name, bit, width, Access::ReadOnly)
}

/// A bit that software sets and the core clears ("rs").
const fn rs(name: &'static str, bit: u8) -> FieldSpec {
    FieldSpec::new(name, bit, 1, Access::ReadWrite).with_write(WriteModify::OneToSet)
}

/// A flag that the core sets and software clears by writing one ("rc_w1").
const fn flag(name: &'static str, bit: u8) -> FieldSpec {
    FieldSpec::new(name, bit, 1, Access::ReadWrite).with_write(WriteModify::OneToClear)
}

/// Declares the fields of one register: a constant for each, and the list for the table.
macro_rules! fields {
    ($(#[$about:meta])* $module:ident { $($name:ident = $kind:ident($($argument:expr),*);)+ }) => {
        $(#[$about])*
        #[allow(missing_docs)] // The names are the manual's own.
        pub mod $module {
            use super::FieldSpec;
            #[allow(unused_imports)] // Not every register has a field of each kind.
            use super::{flag, ro, rs, rw};
            $(pub const $name: FieldSpec = $kind(stringify!($name), $($argument),*);)+
            /// Every field, by position.
            pub static ALL: &[FieldSpec] = &[$($name),+];
        }
    };
}

fields! {
    /// Control and status, 34.16.2. BVALOEN and BVALOVAL are the F446's (RM0390),
    /// reserved in the F405.
    gotgctl {
        SRQSCS = ro(0, 1); SRQ = rw(1, 1); VBVALOEN = rw(2, 1); VBVALOVAL = rw(3, 1); AVALOEN = rw(4, 1);
        AVALOVAL = rw(5, 1); BVALOEN = rw(6, 1); BVALOVAL = rw(7, 1); HNGSCS = ro(8, 1); HNPRQ = rw(9, 1);
        HSHNPEN = rw(10, 1); DHNPEN = rw(11, 1); CIDSTS = ro(16, 1); DBCT = ro(17, 1); ASVLD = ro(18, 1);
        BSVLD = ro(19, 1);
    }
}
fields! {
    /// Interrupts of the session, 34.16.2.
    gotgint {
        SEDET = flag(2); SRSSCHG = flag(8); HNSSCHG = flag(9); HNGDET = flag(17); ADTOCHG = flag(18);
        DBCDNE = flag(19);
    }
}
fields! {
    /// AHB configuration, 34.16.2.
    gahbcfg { GINT = rw(0, 1); TXFELVL = rw(7, 1); PTXFELVL = rw(8, 1); }
}
fields! {
    /// USB configuration, 34.16.2.
    gusbcfg {
        TOCAL = rw(0, 3); PHYSEL = rw(6, 1); SRPCAP = rw(8, 1); HNPCAP = rw(9, 1); TRDT = rw(10, 4);
        FHMOD = rw(29, 1); FDMOD = rw(30, 1); CTXPKT = rw(31, 1);
    }
}
fields! {
    /// Resets and flushes, 34.16.2.
    grstctl {
        CSRST = rs(0); HSRST = rs(1); FCRST = rs(2); RXFFLSH = rs(4); TXFFLSH = rs(5); TXFNUM = rw(6, 5);
        AHBIDL = ro(31, 1);
    }
}
fields! {
    /// Core interrupts, 34.16.2.
    gintsts {
        CMOD = ro(0, 1); MMIS = flag(1); OTGINT = ro(2, 1); SOF = flag(3); RXFLVL = ro(4, 1); NPTXFE = ro(5, 1);
        GINAKEFF = ro(6, 1); GONAKEFF = ro(7, 1); ESUSP = flag(10); USBSUSP = flag(11); USBRST = flag(12);
        ENUMDNE = flag(13); ISOODRP = flag(14); EOPF = flag(15); IEPINT = ro(18, 1); OEPINT = ro(19, 1);
        IISOIXFR = flag(20); IPXFR = flag(21); HPRTINT = ro(24, 1); HCINT = ro(25, 1); PTXFE = ro(26, 1);
        CIDSCHG = flag(28); DISCINT = flag(29); SRQINT = flag(30); WKUPINT = flag(31);
    }
}
fields! {
    /// Mask of the core interrupts, 34.16.2: one for each of them.
    gintmsk { MASK = rw(1, 31); }
}
fields! {
    /// Status of a received packet, device mode, 34.16.2.
    grxsts { EPNUM = ro(0, 4); BCNT = ro(4, 11); DPID = ro(15, 2); PKTSTS = ro(17, 4); FRMNUM = ro(21, 4); }
}
fields! {
    /// Receive FIFO size in words, 34.16.2.
    grxfsiz { RXFD = rw(0, 16); }
}
fields! {
    /// Start and depth of a transmit FIFO in words, 34.16.2: DIEPTXF0 to DIEPTXF5.
    dieptxf { SA = rw(0, 16); FD = rw(16, 16); }
}
fields! {
    /// General core configuration, 34.16.2. In the F446 (RM0390) bit 21 is VBDEN and
    /// means the opposite.
    gccfg { PWRDWN = rw(16, 1); VBUSASEN = rw(18, 1); VBUSBSEN = rw(19, 1); SOFOUTEN = rw(20, 1); BIT21 = rw(21, 1); }
}
fields! {
    /// Device configuration, 34.16.4.
    dcfg { DSPD = rw(0, 2); NZLSOHSK = rw(2, 1); DAD = rw(4, 7); PFIVL = rw(11, 2); }
}
fields! {
    /// Device control, 34.16.4.
    dctl {
        RWUSIG = rw(0, 1); SDIS = rw(1, 1); GINSTS = ro(2, 1); GONSTS = ro(3, 1); TCTL = rw(4, 3); SGINAK = rs(7);
        CGINAK = rs(8); SGONAK = rs(9); CGONAK = rs(10); POPRGDNE = rw(11, 1);
    }
}
fields! {
    /// Device status, 34.16.4.
    dsts { SUSPSTS = ro(0, 1); ENUMSPD = ro(1, 2); EERR = ro(3, 1); FNSOF = ro(8, 14); }
}
fields! {
    /// Common mask of the IN endpoints' interrupts, 34.16.4.
    diepmsk { XFRCM = rw(0, 1); EPDM = rw(1, 1); TOM = rw(3, 1); ITTXFEMSK = rw(4, 1); INEPNMM = rw(5, 1); INEPNEM = rw(6, 1); }
}
fields! {
    /// Common mask of the OUT endpoints' interrupts, 34.16.4.
    doepmsk { XFRCM = rw(0, 1); EPDM = rw(1, 1); STUPM = rw(3, 1); OTEPDM = rw(4, 1); }
}
fields! {
    /// The endpoints with an interrupt, and their masks, 34.16.4.
    daint { IEP = rw(0, 16); OEP = rw(16, 16); }
}
fields! {
    /// The IN endpoints that interrupt on an empty FIFO, 34.16.4.
    diepempmsk { INEPTXFEM = rw(0, 16); }
}
fields! {
    /// Control of IN endpoint 0, 34.16.4.
    diepctl0 {
        MPSIZ = rw(0, 2); USBAEP = ro(15, 1); NAKSTS = ro(17, 1); EPTYP = ro(18, 2); STALL = rs(21);
        TXFNUM = rw(22, 4); CNAK = rs(26); SNAK = rs(27); EPDIS = rs(30); EPENA = rs(31);
    }
}
fields! {
    /// Control of OUT endpoint 0, 34.16.4. MPSIZ follows that of IN endpoint 0, and software
    /// cannot disable it.
    doepctl0 {
        MPSIZ = ro(0, 2); USBAEP = ro(15, 1); NAKSTS = ro(17, 1); EPTYP = ro(18, 2); SNPM = rw(20, 1); STALL = rs(21);
        CNAK = rs(26); SNAK = rs(27); EPDIS = ro(30, 1); EPENA = rs(31);
    }
}
fields! {
    /// Control of the other endpoints, IN and OUT, 34.16.4. TXFNUM exists in IN endpoints only,
    /// SNPM in OUT ones.
    epctl {
        MPSIZ = rw(0, 11); USBAEP = rw(15, 1); DPID = ro(16, 1); NAKSTS = ro(17, 1); EPTYP = rw(18, 2);
        SNPM = rw(20, 1); STALL = rw(21, 1); TXFNUM = rw(22, 4); CNAK = rs(26); SNAK = rs(27); SD0PID = rs(28);
        SD1PID = rs(29); EPDIS = rs(30); EPENA = rs(31);
    }
}
fields! {
    /// Interrupts of an IN endpoint, 34.16.4.
    diepint { XFRC = flag(0); EPDISD = flag(1); TOC = flag(3); ITTXFE = flag(4); INEPNE = flag(6); TXFE = ro(7, 1); }
}
fields! {
    /// Interrupts of an OUT endpoint, 34.16.4.
    doepint { XFRC = flag(0); EPDISD = flag(1); STUP = flag(3); OTEPDIS = flag(4); B2BSTUP = flag(6); }
}
fields! {
    /// Transfer size of IN endpoint 0, 34.16.4.
    dieptsiz0 { XFRSIZ = rw(0, 7); PKTCNT = rw(19, 2); }
}
fields! {
    /// Transfer size of OUT endpoint 0, 34.16.4.
    doeptsiz0 { XFRSIZ = rw(0, 7); PKTCNT = rw(19, 1); STUPCNT = rw(29, 2); }
}
fields! {
    /// Transfer size of the other endpoints, 34.16.4. MCNT counts packets per frame in IN endpoints
    /// and holds the received packet's identifier in isochronous OUT ones.
    eptsiz { XFRSIZ = rw(0, 19); PKTCNT = rw(19, 10); MCNT = rw(29, 2); }
}
fields! {
    /// Free words of an IN endpoint's FIFO, 34.16.4.
    dtxfsts { INEPTFSAV = ro(0, 16); }
}
fields! {
    /// Power and clock gating, 34.16.5.
    pcgcctl { STPPCLK = rw(0, 1); GATEHCLK = rw(1, 1); PHYSUSP = ro(4, 1); }
}
