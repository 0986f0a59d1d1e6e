"use strict"
// Runs ahead of viser's client: the colours of the visitor's system, keys, and names of controls.
const night = matchMedia("(prefers-color-scheme: dark)")
window.__VISER_EMBED_CONFIG__ = {darkMode: night.matches}
// viser takes colours at its start only, and a reload would lose time and tab: its styles follow this.
night.addEventListener("change", () => {
    window.__VISER_EMBED_CONFIG__.darkMode = night.matches
    document.documentElement.dataset.mantineColorScheme = night.matches ? "dark" : "light"
    const scene = [...document.querySelectorAll("canvas")].find(one => !one.closest(".uplot"))
    const back = scene?.closest("[style*='background-color']")
    if (back) back.style.backgroundColor = night.matches ? "var(--mantine-color-dark-9)" : "#fff"
})

// What has keys of its own keeps them: they bubble up to viser's root, and no further.
const busy = "input, textarea, select, [role=slider], [role=option]"
const pressed = "button:not([role=tab]), [role=button]"
const sideways = ["ArrowLeft", "ArrowRight"]
const keys = ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"]
addEventListener("DOMContentLoaded", () => {
    document.body.addEventListener("keydown", event => {
        const presses = [" ", "Enter"].includes(event.key) && event.target.closest(pressed)
        const turns = sideways.includes(event.key) && event.target.closest("[role=tab]")
        if (presses || turns || event.target.closest(busy)) event.stopPropagation()
    })
    // A tab has the arrows; it would turn home and end into the first tab and the last one.
    addEventListener("keydown", event => {
        if (![" ", "Home", "End"].includes(event.key) || !event.target.closest?.("[role=tab]")) return
        event.stopImmediatePropagation()
        event.preventDefault()
        document.body.dispatchEvent(new KeyboardEvent("keydown", event))
    }, true)
    // The arrows step in time; viser would move its camera as well, which W, A, S and D do.
    document.documentElement.addEventListener("keydown", event => {
        if (keys.includes(event.key)) event.stopPropagation()
    })
    document.documentElement.lang = "en"
    new MutationObserver(() => {
        // Now: on a busy page the next frame comes late, and a screen reader may read before it.
        nameControls()
        waiting ??= requestAnimationFrame(name)
    })
        .observe(document.body, {childList: true, subtree: true, characterData: true})
})

// Charts have their axes; legends say the values at the playhead, or the newest ones, unless the mouse
// points at others.
setInterval(() => {
    for (const {chart} of Object.values(window.__viserTestpoints?.uplots ?? {})) {
        // On a busy page, a chart whose data come before its first draw has no axes.
        if (chart.axes.some(one => one.show && !one._splits)) chart.redraw(true, true)
        const {data, series, scales, cursor, legend} = chart
        const now = data?.[series.findIndex(one => one.label === "\u2060now")]
        if (!now?.length || cursor.left >= 0) continue
        const top = now.findIndex(y => y > scales.y.max)
        const at = top < 0 ? now.length - 1 : top
        // Where there is no value, a line is below its chart.
        const idxs = data.map((row, number) => number && row[at] < scales.y.min ? null : at)
        if (legend.idx !== at) chart.setLegend({idxs})
    }
}, 200)

const all = (query, work) => document.querySelectorAll(query).forEach(work)
const set = (node, key, value) => {
    if (node && node.getAttribute(key) !== value) node.setAttribute(key, value)
}

// A button with an icon only is named by it: `tabler-icon-maximize` enlarges a chart.
const actions = {maximize: "enlarge the chart", adjustments: "settings"}
function nameControls() {
    all("button:not([aria-label])", button => {
        if (button.textContent.trim()) return
        const icon = [...button.querySelector("svg")?.classList ?? []].find(one => one.startsWith("tabler-icon-"))
        const action = icon?.slice("tabler-icon-".length)
        set(button, "aria-label", button.title || actions[action] || action || "settings")
    })
    // A slider and its field share a label, which is for neither.
    all(".mantine-Slider-root", slider => {
        const label = document.querySelector(`label[for="${slider.id}"]`)?.textContent
        if (!label) return
        set(slider.querySelector("[role=slider]"), "aria-label", label)
        set(slider.parentNode.querySelector("input:not([type=hidden])"), "aria-label", label)
    })
}

let waiting = null
function name() {
    waiting = null
    set(document.getElementById("root"), "role", "main")
    all(".mantine-Slider-markLabel", mark => set(mark, "data-mark", mark.textContent))
    // The heads of folders and of the panel are clicked at: they are buttons.
    all("[style*='cursor: pointer']", head => {
        if (head.closest("button, a, [role=tab]") || head.querySelector("button, a")) return
        set(head, "role", "button")
        set(head, "tabindex", "0")
        head.onkeydown ??= event => {
            if (event.target === head && ["Enter", " "].includes(event.key)) {
                event.preventDefault()
                head.click()
            }
        }
    })
    // Limits, marks and the playhead have no place in a legend; others look as they are drawn.
    all(".u-series", row => {
        const has = sign => row.textContent.includes(sign)
        row.hidden = has("\u2060")
        set(row, "data-line", `${has("\u2061") ? "broken" : ""} ${has("\u2062") ? "thin" : ""}`)
    })
    // The title of a live page is known when its run begins.
    const title = document.querySelector("[data-testid$=panel-handle]")?.textContent.trim()
    if (title && document.title !== `${title} · stepbus`) document.title = `${title} · stepbus`
    all("canvas", canvas => {
        const title = canvas.closest(".uplot")?.querySelector(".u-title")?.textContent
        set(canvas, "role", "img")
        set(canvas, "aria-label", title ? `curves of ${title}` : "the scene")
    })
}
