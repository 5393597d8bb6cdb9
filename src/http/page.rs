//! The web page, embedded: no build step, no request to any other machine.

use super::HttpState;
use axum::Router;
use axum::http::header;
use axum::response::IntoResponse;
use axum::routing::get;

const SCRIPT: &str = "text/javascript; charset=utf-8";

const SHADER: &str = "text/plain; charset=utf-8";

const FILES: &[(&str, &str, &str)] = &[
    ("/", "text/html; charset=utf-8", include_str!("../../web/index.html")),
    ("/page.css", "text/css; charset=utf-8", include_str!("../../web/page.css")),
    ("/icon.svg", "image/svg+xml", include_str!("../../web/icon.svg")),
    ("/api.js", SCRIPT, include_str!("../../web/api.js")),
    ("/calibration.js", SCRIPT, include_str!("../../web/calibration.js")),
    ("/chart.js", SCRIPT, include_str!("../../web/chart.js")),
    ("/checks.js", SCRIPT, include_str!("../../web/checks.js")),
    ("/command.js", SCRIPT, include_str!("../../web/command.js")),
    ("/compare.js", SCRIPT, include_str!("../../web/compare.js")),
    ("/dashboard.js", SCRIPT, include_str!("../../web/dashboard.js")),
    ("/dome.js", SCRIPT, include_str!("../../web/dome.js")),
    ("/frames.js", SCRIPT, include_str!("../../web/frames.js")),
    ("/health.js", SCRIPT, include_str!("../../web/health.js")),
    ("/history.js", SCRIPT, include_str!("../../web/history.js")),
    ("/journal.js", SCRIPT, include_str!("../../web/journal.js")),
    ("/live.js", SCRIPT, include_str!("../../web/live.js")),
    ("/material.js", SCRIPT, include_str!("../../web/material.js")),
    ("/mistakes.js", SCRIPT, include_str!("../../web/mistakes.js")),
    ("/page.js", SCRIPT, include_str!("../../web/page.js")),
    ("/picture.js", SCRIPT, include_str!("../../web/picture.js")),
    ("/plan.js", SCRIPT, include_str!("../../web/plan.js")),
    ("/queue.js", SCRIPT, include_str!("../../web/queue.js")),
    ("/results.js", SCRIPT, include_str!("../../web/results.js")),
    ("/rig.js", SCRIPT, include_str!("../../web/rig.js")),
    ("/run.js", SCRIPT, include_str!("../../web/run.js")),
    ("/settings.js", SCRIPT, include_str!("../../web/settings.js")),
    ("/show.js", SCRIPT, include_str!("../../web/show.js")),
    ("/verbs.js", SCRIPT, include_str!("../../web/verbs.js")),
    ("/viewer.js", SCRIPT, include_str!("../../web/viewer.js")),
    ("/viewer-files.js", SCRIPT, include_str!("../../web/viewer-files.js")),
    ("/viewer-gl.js", SCRIPT, include_str!("../../web/viewer-gl.js")),
    ("/viewer-hands.js", SCRIPT, include_str!("../../web/viewer-hands.js")),
    ("/viewer-space.js", SCRIPT, include_str!("../../web/viewer-space.js")),
    ("/viewer-brdf.glsl", SHADER, include_str!("../../web/viewer-brdf.glsl")),
    ("/viewer-depth.glsl", SHADER, include_str!("../../web/viewer-depth.glsl")),
    ("/viewer-mesh.glsl", SHADER, include_str!("../../web/viewer-mesh.glsl")),
    ("/viewer-mesh-vertex.glsl", SHADER, include_str!("../../web/viewer-mesh-vertex.glsl")),
    ("/viewer-object.glsl", SHADER, include_str!("../../web/viewer-object.glsl")),
    ("/viewer-screen-vertex.glsl", SHADER, include_str!("../../web/viewer-screen-vertex.glsl")),
    ("/viewer-shade.glsl", SHADER, include_str!("../../web/viewer-shade.glsl")),
    ("/viewer-show.glsl", SHADER, include_str!("../../web/viewer-show.glsl")),
];

/// The page may load and ask nothing but this daemon, and no other page may frame its buttons.
const POLICY: &str =
    "default-src 'self'; img-src 'self' blob:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

/// Whether this is the path of a part of the page.
pub(super) fn has(path: &str) -> bool {
    FILES.iter().any(|(known, _, _)| *known == path)
}

pub(super) fn routes() -> Router<HttpState> {
    FILES.iter().fold(Router::new(), |router, &(path, kind, text)| {
        let headers = [
            (header::CONTENT_TYPE, kind),
            (header::CONTENT_SECURITY_POLICY, POLICY),
            (header::CACHE_CONTROL, "no-cache"),
        ];
        router.route(path, get(move || async move { (headers, text).into_response() }))
    })
}
